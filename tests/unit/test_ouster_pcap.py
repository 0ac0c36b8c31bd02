"""The decoder's frames as bytes, and what is said where ouster-sdk is missing. Decoding itself needs ouster-sdk."""

import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from services.sensors.sources.frames import FrameError, read_frames
from services.sensors.sources.ouster_pcap import metadata_of, read_pcap
from shared.errors import InputFileError

POINTS_M = np.arange(6, dtype="<f4").reshape(2, 3)
RING = np.array([3, 10], dtype="<u2")  # 10 is a line's end as a byte
SCAN = (
    json.dumps({"kind": "scan", "stamp_ns": 2**60, "arrays": [["points_m", "<f4", [2, 3]], ["ring", "<u2", [2]]]})
    + "\n"
).encode()
SCAN += POINTS_M.tobytes() + RING.tobytes()
IMU = b'{"kind": "imu", "stamp_ns": 5, "arrays": [["angular_velocity_radps", "<f8", [3]]]}\n' + np.ones(3).tobytes()
END = b'{"kind": "end", "arrays": []}\n'


def frames(data):
    return read_frames(io.BytesIO(data))


def test_frames():
    scan, reading, empty = frames(SCAN + IMU + b'{"kind": "scan", "stamp_ns": 6, "arrays": []}\n' + END + b"after")
    assert (scan.kind, scan.stamp_ns, list(scan.arrays)) == ("scan", 2**60, ["points_m", "ring"])
    np.testing.assert_array_equal(scan.arrays["points_m"], POINTS_M)
    np.testing.assert_array_equal(scan.arrays["ring"], RING)
    assert (reading.kind, reading.stamp_ns) == ("imu", 5)
    np.testing.assert_array_equal(reading.arrays["angular_velocity_radps"], [1, 1, 1])
    assert empty.arrays == {}


def test_an_error_comes_after_what_was_read():
    read = frames(SCAN + b'{"kind": "error", "text": "out of packets", "arrays": []}\n')
    assert next(read).kind == "scan"
    with pytest.raises(FrameError, match="out of packets"):
        next(read)


@pytest.mark.parametrize("data", [b"", SCAN, SCAN[:-1], SCAN[:30], b"Segmentation fault\n", IMU[:-24] + b"\n" * 23])
def test_a_pipe_that_ends_too_early(data):
    with pytest.raises(FrameError, match=r"^$"):
        list(frames(data))


@pytest.fixture
def pcap(tmp_path):
    for name in ("run.pcap", "run.json"):
        (tmp_path / name).write_text("{}")
    return tmp_path / "run.pcap"


def refusal(pcap, python):
    with pytest.raises(InputFileError) as caught:
        next(read_pcap(pcap, metadata_of(pcap), python, "lidar"))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_without_the_environment(pcap):
    said = refusal(pcap, Path("/nowhere/python"))
    assert said == (
        f"{pcap}: reading it needs ouster-sdk, and /nowhere/python is missing: make ouster, or set OUSTER_PYTHON"
    )


def test_an_interpreter_without_the_sdk(pcap):
    assert "has no ouster-sdk (ModuleNotFoundError" in refusal(pcap, Path(sys.executable))


def test_missing_files(pcap):
    metadata_of(pcap).unlink()
    assert refusal(pcap, Path(sys.executable)).startswith(f"{pcap.with_suffix('.json')}: no such file: the metadata of")
    pcap.unlink()
    assert refusal(pcap, Path(sys.executable)) == f"{pcap}: no such file"
