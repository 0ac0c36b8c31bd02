import fcntl
import time

import numpy as np
import pytest

from shared.errors import InputFileError, SnapshotError
from shared.messaging.messages import Clock, Event, Foot, LegTarget, Severity, Stop
from shared.runtime import snapshots
from shared.runtime.config import Config
from shared.runtime.memory import Keeper
from shared.runtime.node import Memory, Part
from shared.runtime.snapshots import Snapshots, settings_of, state_folder

STATE = Clock(stamp_ns=5, seq=7, frame="")


def clock(seq):
    return Clock(stamp_ns=0, seq=seq, frame="")


@pytest.fixture
def kept(tmp_path):
    here = Snapshots(tmp_path, "sim", "settings")
    here.write("state", STATE)
    return here


def test_what_is_written_is_read_and_the_last_counts(kept, tmp_path):
    assert kept.read("state", Clock) == STATE
    kept.write("state", clock(8))
    assert kept.read("state", Clock).seq == 8
    assert [path.name for path in tmp_path.iterdir()] == ["sim.state"]


def test_where_nothing_was_written_there_is_none(kept):
    assert kept.read("map", Clock) is None


def test_every_damage_is_told(kept, tmp_path):
    path = tmp_path / "sim.state"
    whole = path.read_bytes()
    damaged = [whole[:size] for size in range(len(whole))]
    damaged += [whole[:i] + bytes([byte ^ 0x10]) + whole[i + 1 :] for i, byte in enumerate(whole)]
    for data in [*damaged, whole + b"\0", b"\xff" * 100]:
        path.write_bytes(data)
        with pytest.raises(SnapshotError, match=r"sim\.state: is"):
            kept.read("state", Clock)


@pytest.mark.parametrize(
    ("reader", "kind", "reason"),
    [
        (("mapper", "settings"), Clock, "is of the service sim"),
        (("sim", "others"), Clock, "was made with another configuration"),
        (("sim", "settings"), Stop, "schema is 'hyrecro.Clock/1', expected 'hyrecro.Stop/1'"),
    ],
)
def test_what_belongs_to_others_is_refused(kept, tmp_path, reader, kind, reason):
    (tmp_path / "mapper.state").write_bytes((tmp_path / "sim.state").read_bytes())
    with pytest.raises(SnapshotError, match=reason):
        Snapshots(tmp_path, *reader).read("state", kind)


def test_a_death_while_it_is_written_leaves_the_one_before(kept, tmp_path):
    (tmp_path / "sim.state.new").write_bytes(b"HYREC")
    assert kept.read("state", Clock) == STATE
    kept.write("state", clock(9))
    assert kept.read("state", Clock).seq == 9


def test_settings_that_a_restart_may_change_do_not_count():
    config = Config.model_validate({})
    other = config.model_copy(update={"recorder": config.recorder.model_copy(update={"run": "another"})})
    assert settings_of(config) == settings_of(other)
    assert settings_of(config) != settings_of(config.model_copy(update={"seed": 2}))


# ---- the folder of a run


def test_a_run_begins_with_an_empty_folder_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(snapshots, "_MEMORY", tmp_path)
    with state_folder(None) as first, state_folder(None) as second:
        assert first != second
        assert [path.name for path in first.iterdir()] == ["lock"]
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_launcher_left_is_removed_and_what_lives_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(snapshots, "_MEMORY", tmp_path)
    for name in ("dead", "alive"):
        folder = tmp_path / f"hyrecro-state-{name}"
        folder.mkdir()
        (folder / "lock").touch()
    with (tmp_path / "hyrecro-state-alive" / "lock").open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with state_folder(None):
            names = {path.name for path in tmp_path.iterdir()}
    assert "hyrecro-state-alive" in names
    assert "hyrecro-state-dead" not in names


def test_a_chosen_folder_is_made_and_stays(tmp_path):
    with state_folder(tmp_path / "deep" / "here") as folder:
        Snapshots(folder, "sim", "").write("state", STATE)
    assert (folder / "sim.state").exists()
    (tmp_path / "file").touch()
    with pytest.raises(InputFileError, match="state_directory"), state_folder(tmp_path / "file" / "here"):
        pass


# ---- what the runner does


class Service:
    def __init__(self, folder, period_s=0.0):
        self.state, self.restored = clock(0), None
        part = Part(Clock, lambda: self.state, period_s)
        self.keeper = Keeper(Memory({"state": part}, self.restore), Snapshots(folder, "sim", "settings"), "sim")

    def restore(self, states):
        if states["state"].seq == 13:
            raise ValueError("thirteen")
        self.restored = states["state"]
        return [LegTarget(foot=Foot.A)]


def test_a_restarted_service_gets_what_the_last_one_kept(tmp_path):
    first, second = Service(tmp_path), Service(tmp_path)
    assert first.keeper.recall() == []
    first.state = clock(4)
    assert first.keeper.before_said() == []
    assert second.keeper.recall() == [LegTarget(foot=Foot.A)]
    assert second.restored.seq == 4


@pytest.mark.parametrize("spoil", [lambda path: path.write_bytes(b"x"), None])
def test_what_is_not_usable_is_said_and_the_service_begins_afresh(tmp_path, spoil):
    first, second = Service(tmp_path), Service(tmp_path)
    first.state = clock(13)
    first.keeper.before_said()
    if spoil:
        spoil(tmp_path / "sim.state")
    (event,) = second.keeper.recall()
    assert isinstance(event, Event)
    assert event.severity is Severity.WARNING
    assert event.text.startswith("begins afresh, its snapshot is not usable: ")
    assert second.restored is None


def test_a_part_with_a_period_is_kept_as_soon_as_there_is_something_and_then_waits(tmp_path):
    service = Service(tmp_path, period_s=3600.0)
    service.state = None
    assert service.keeper.before_said() == service.keeper.after_said() == []
    assert list(tmp_path.iterdir()) == []
    for seq in (3, 4):
        service.state = clock(seq)
        service.keeper.after_said()
    service.keeper.recall()
    assert service.restored.seq == 3
    often = Service(tmp_path, period_s=1e-9)
    often.state = clock(3)
    often.keeper.after_said()
    often.state = clock(4)
    end_s = time.monotonic() + 30.0
    while often.restored is None or often.restored.seq == 3:  # due after fifty times what the first writing took
        assert time.monotonic() < end_s
        often.keeper.after_said()
        often.keeper.recall()


def test_a_folder_that_is_gone_is_told_once(tmp_path):
    service = Service(tmp_path / "nowhere")
    (event,) = service.keeper.before_said()
    assert "its state is not kept" in event.text
    assert service.keeper.before_said() == []


def test_nothing_is_kept_before_there_is_something(tmp_path):
    service = Service(tmp_path)
    service.state = None
    assert service.keeper.before_said() == []
    assert service.keeper.recall() == []


def test_arrays_come_back_as_they_were(tmp_path):
    from services.mapper.state import VoxelsState

    state = VoxelsState(keys=np.arange(3), sums_m=np.random.default_rng(1).random((3, 3)), counts=np.ones(3))
    here = Snapshots(tmp_path, "mapper", "")
    here.write("map", state)
    assert here.read("map", VoxelsState) == state
