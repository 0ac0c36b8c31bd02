"""The recorder as a process: commands, SIGKILL, a disk that fills, exit codes."""

import contextlib
import json
import resource
import shutil
import signal
import subprocess
import time

import pytest
from mcap.reader import make_reader

from bench.recorder_kills import accounted, recovered
from bench.recorder_load import full_load, publish
from services.recorder.bag.recording import Recording
from shared.messaging.channels import DEPTH_IMAGE, EVENTS, RECORDER_STATUS
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Event, RecorderStatus, Severity
from tests.e2e.conftest import wait_for_services
from tests.support.processes import hyrecro_command, service_command, started, wait_until

pytestmark = pytest.mark.e2e

SMALL = tuple(stream for stream in full_load() if stream.rate_hz >= 100)
IMAGES = tuple(stream for stream in full_load() if stream.channel is DEPTH_IMAGE)


@pytest.fixture
def router(tmp_path):
    with started(hyrecro_command("router"), tmp_path / "router") as running:
        wait_for_services(running, set())
        yield running


@pytest.fixture
def disk(tmp_path):
    """A disk of 20 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount, umount = shutil.which("mount"), shutil.which("umount")
    if not (mount and umount) or subprocess.run([mount, "-t", "tmpfs", "-o", "size=20m", "none", folder]).returncode:
        pytest.skip("mounting a small disk is not allowed here; RLIMIT_FSIZE is tested in its place")
    yield folder
    subprocess.run([umount, folder], check=True)


@contextlib.contextmanager
def recorder(router, directory, *settings):
    options = [part for setting in ("recorder.run=here", *settings) for part in ("--set", setting)]
    with started(service_command("services.recorder", *options), directory, router.endpoint) as running:
        wait_for_services(running, {"recorder"})
        yield running


def status(bus):
    return bus.ask(RECORDER_STATUS, RecorderStatus)


def fill(running):
    """Publishes images until the recorder stops by itself; returns what it says."""
    inbox = Inbox()
    with running.bus() as bus:
        bus.subscribe(EVENTS, inbox)
        publish(bus, SMALL + IMAGES, 3.0)
        said = wait_until(lambda: (now := status(bus)) and now.text and now, "the recorder has stopped")
        publish(bus, SMALL, 0.5)
        event = decode(Event, inbox.take(5.0).payload)
    assert (event.severity, event.source) == (Severity.ERROR, "recorder")
    assert said.text in event.text
    assert not said.is_recording
    return said.text


def check_partial(running, folder, reason):
    """The process ends with 3; its file is readable, says INCOMPLETE and why, and its counts are true."""
    path = folder / "here" / "run.mcap"
    with running.bus() as bus:
        last = status(bus)
    assert running.stop(signal.SIGTERM) == 3
    assert (Recording(path).state, last.path) == ("INCOMPLETE", str(path))
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        num_messages = sum(1 for _ in reader.iter_messages())
        metadata = {entry.name: entry.metadata for entry in reader.iter_metadata()}
    assert metadata["hyrecro_end"] == {"state": "INCOMPLETE", "reason": reason}
    counts = [json.loads(text) for text in metadata["hyrecro_counts"].values()]
    assert num_messages == sum(count["num_written"] for count in counts) > 0
    assert num_messages == sum(record.num_written for record in last.channels)
    for record in last.channels:
        assert record.num_received == record.num_written + record.num_lost_to_disk


def test_a_disk_that_fills_ends_the_recording_with_room_to_spare(router, disk):
    with recorder(router, disk, "recorder.min_free_mib=2") as running:
        text = fill(running)
        assert "MiB left, recorder.min_free_mib keeps 2 free" in text
        check_partial(running, disk, text)


def test_a_disk_that_fills_to_the_last_byte(router, disk):
    with recorder(router, disk, "recorder.min_free_mib=0", "recorder.compression=none") as running:
        text = fill(running)
        assert "the disk has" in text or "No space left" in text
        check_partial(running, disk, text)


def test_a_disk_that_refuses_and_room_again(router, tmp_path):
    with recorder(router, tmp_path / "rec") as running:
        limit = resource.prlimit(running.process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(running.process.pid, resource.RLIMIT_FSIZE, (5_000_000, limit[1]))
        text = fill(running)
        assert "File too large" in text
        refused = running.hyrecro("record", "stop")
        assert (refused.returncode, "nothing is being recorded: " in refused.stderr) == (1, True)
        resource.prlimit(running.process.pid, resource.RLIMIT_FSIZE, limit)
        assert running.hyrecro("record", "start", "--run", "again").returncode == 0
        with running.bus() as bus:
            publish(bus, SMALL, 0.5)
        assert running.hyrecro("record", "stop").returncode == 0
        assert Recording(tmp_path / "rec" / "again" / "run.mcap").state == "COMPLETE"
        assert running.stop(signal.SIGTERM) == 3, "the first recording lacks something"


def test_start_stop_and_status_by_command(router, tmp_path):
    with recorder(router, tmp_path / "rec", "recorder.starts=false") as running:
        shown = running.hyrecro("record", "status")
        assert (shown.returncode, "nothing is being recorded" in shown.stdout) == (0, True)
        assert [path.name for path in (tmp_path / "rec").iterdir()] == ["stderr.txt"]
        begun = json.loads(running.hyrecro("record", "start", "depth/*", "--run", "one", "--json").stdout)
        assert (begun["is_recording"], begun["path"]) == (True, str(tmp_path / "rec" / "one" / "run.mcap"))
        again = running.hyrecro("record", "start")
        assert (again.returncode, "is being recorded: stop it first" in again.stderr) == (1, True)
        with running.bus() as bus:
            num_sent = publish(bus, SMALL, 1.0)
        ended = running.hyrecro("record", "stop", "--json")
        report = json.loads(ended.stdout)
        (record,) = report["channels"]
        assert record["key"] == "depth/imu"
        assert record["num_received"] == record["num_written"] == num_sent["depth/imu"] - record["num_lost_on_bus"]
        assert ended.returncode == (3 if report["num_lost"] else 0)
        wrong = running.hyrecro("record", "start", "lidr/*")
        assert wrong.returncode == 1
        assert "recorder/control: channels: 'lidr/*' matches no recorded key, such as lidar/points" in wrong.stderr


@pytest.mark.parametrize("seconds", [0.3, 0.9, 1.5])
def test_a_killed_recorder_leaves_every_whole_chunk(router, tmp_path, seconds):
    with recorder(router, tmp_path / "rec") as running, running.bus() as bus, (tmp_path / "log").open("w+") as log:
        publish(bus, SMALL + IMAGES, seconds, log)
        said = status(bus)
        running.process.kill()
        running.process.wait()
        log.flush()
    path = tmp_path / "rec" / "here" / "run.mcap"
    kill = accounted(recovered(path), tmp_path / "log", time.monotonic_ns(), seconds, 0)
    assert kill.balances
    keys = {stream.channel.key for stream in SMALL + IMAGES}
    assert kill.num_in_file >= sum(record.num_written for record in said.channels if record.key in keys)
