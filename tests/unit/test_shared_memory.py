"""Segments of shared memory: whose they are, and that those of the dead take no memory."""

import mmap
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from shared.runtime.shared_memory import FOLDER, bus_memory_bytes, empty_abandoned, mapped_segments, own

SIZE = 2**20


@pytest.fixture
def folder():
    with tempfile.TemporaryDirectory(dir=FOLDER) as path:
        yield Path(path)


def segment(folder, name):
    path = folder / f"{name}.zenoh"
    path.write_bytes(b"x" * SIZE)
    return path


def test_the_bus_memory_is_that_of_its_segments(folder):
    segment(folder, "12345")
    (folder / "other").write_bytes(bytes(SIZE))
    assert bus_memory_bytes(folder) == SIZE
    assert bus_memory_bytes(folder / "none") == 0


def test_a_segment_keeps_its_memory_while_its_owner_has_it(folder):
    path = segment(folder, "1")
    with own(path):
        assert empty_abandoned(folder) == 0
        assert path.read_bytes() == b"x" * SIZE
    assert empty_abandoned(folder) == 1
    assert bus_memory_bytes(folder) == 0
    assert path.stat().st_size == SIZE  # who reads it still reads zeros, and does not die of it
    assert [each.name for each in folder.iterdir()] == ["1.zenoh"]
    assert empty_abandoned(folder) == 0


def test_a_killed_owner_has_it_no_more(folder):
    path = segment(folder, "1")
    code = f"import pathlib, shared.runtime.shared_memory as m; lock = m.own(pathlib.Path({str(path)!r})); "
    with subprocess.Popen([sys.executable, "-c", code + "print(1, flush=True); input()"], stdout=-1, stdin=-1) as owner:
        owner.stdout.readline()
        assert empty_abandoned(folder) == 0
        owner.kill()
    assert empty_abandoned(folder) == 1


def test_segments_that_nobody_ever_owned_are_left_alone(folder):
    path = segment(folder, "1")
    assert empty_abandoned(folder) == 0
    assert path.read_bytes() == b"x" * SIZE


def test_a_mark_whose_segment_is_gone_goes_too(folder):
    path = segment(folder, "1")
    own(path).close()
    path.unlink()
    assert empty_abandoned(folder) == 0
    assert list(folder.iterdir()) == []


def test_the_segments_of_this_process_are_those_it_has_mapped(folder):
    path = segment(folder, "1")
    segment(folder, "2")
    with path.open("r+b") as file, mmap.mmap(file.fileno(), 0):
        assert mapped_segments(folder) == {path}
    assert mapped_segments(folder) == set()
