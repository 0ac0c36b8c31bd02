"""The recorder's facade: runs, files, choice of channels, a disk that refuses, counts that balance."""

import contextlib
import json
import resource

import numpy as np
import pytest
from mcap.reader import make_reader

from services.recorder.bag.recording import Recording
from services.recorder.disk import RecordingError
from services.recorder.recorder import Recorder
from services.recorder.records import to_record
from services.recorder.rotation import FileSeries
from services.recorder.run_writer import RunWriter
from shared.errors import ConfigError, RefusedError
from shared.messaging import channels as c, messages as m
from shared.runtime.config import RecorderConfig
from tests.support.examples import EXAMPLES
from tests.support.processes import wait_until

START, STOP = m.RecorderAction.START, m.RecorderAction.STOP
(URDF,) = (example for example in EXAMPLES if isinstance(example, m.RobotDescription))


def clock(seq):
    return m.Clock(stamp_ns=seq * 10**9, seq=seq, frame="")


def cloud(seq, num_points=20_000):
    points_m = np.random.default_rng(seq).random((num_points, 3), np.float32)
    return m.PointCloud(stamp_ns=seq * 10**9, seq=seq, frame="map", points_m=points_m)


def started(directory, **settings):
    settings = {"run": "here", "min_free_mib": 0, **settings}
    recorder = Recorder(RecorderConfig(directory=directory, **settings), {"seed": "1"})
    recorder.start()
    return recorder


def heartbeat_of_lidar(last_seq):
    count = m.ChannelCount(key=c.LIDAR_POINTS.key_expr, num_sent=last_seq + 1, last_seq=last_seq)
    return m.Health(
        stamp_ns=5 + last_seq,
        seq=last_seq // 9,
        frame="",
        service="lidar",
        uptime_s=1.0,
        rss_bytes=0,
        busy_ratio=0.0,
        channels=(count,),
    )


def last_status(messages):
    return messages[-1]


def events(messages):
    return [(event.severity, event.text) for event in messages if isinstance(event, m.Event)]


def content(path):
    """Log times by topic, and the metadata, of a file that was closed."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        times_s = {}
        for _, channel, record in reader.iter_messages():
            times_s.setdefault(channel.topic, []).append(record.log_time / 1e9)
        return times_s, {entry.name: entry.metadata for entry in reader.iter_metadata()}


def counts(path, topic):
    return json.loads(content(path)[1]["hyrecro_counts"][topic])


def state(path):
    return content(path)[1]["hyrecro_end"]["state"]


@contextlib.contextmanager
def files_of_at_most(num_bytes):
    """Lets the kernel refuse what goes beyond `num_bytes` in any file of this process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_whole_recording_is_complete_and_its_counts_balance(tmp_path):
    recorder = started(tmp_path)
    for seq in range(3):
        recorder.add(c.CLOCK, clock(seq))
    recorder.add(c.LEG_TARGET, m.LegTarget(foot=m.Foot.B))
    status = last_status(recorder.close())
    by_key = {record.key: record for record in status.channels}
    assert by_key["clock"] == m.ChannelRecord(key="clock", num_published=3, num_received=3, num_written=3)
    assert by_key["leg/target"] == m.ChannelRecord(key="leg/target", num_received=1, num_written=1)
    assert (status.is_recording, status.num_files, status.text) == (False, 1, "")
    assert status.num_bytes == (tmp_path / "here" / "run.mcap").stat().st_size
    assert state(tmp_path / "here" / "run.mcap") == "COMPLETE"
    assert not recorder.has_lost


def test_what_was_lost_on_the_bus_is_counted_and_said(tmp_path):
    recorder = started(tmp_path)
    for seq in (0, 1, 4):
        recorder.add(c.CLOCK, clock(seq))
    assert events(recorder.tick()) == [(m.Severity.WARNING, "2 messages are not in the recording: clock")]
    count = m.ChannelCount(key=c.CLOCK.key_expr, num_sent=8, last_seq=7)
    health = m.Health(
        stamp_ns=5, seq=0, frame="", service="sim", uptime_s=1.0, rss_bytes=0, busy_ratio=0.0, channels=(count,)
    )
    recorder.add(c.HEALTH, health)
    assert events(recorder.tick()) == []
    record = next(record for record in last_status(recorder.close()).channels if record.key == "clock")
    assert record == m.ChannelRecord(key="clock", num_published=8, num_received=3, num_written=3, num_lost_on_bus=5)
    assert counts(tmp_path / "here" / "run.mcap", "/clock")["num_lost_on_bus"] == 5
    assert state(tmp_path / "here" / "run.mcap") == "INCOMPLETE"
    assert recorder.has_lost


def test_stop_and_start(tmp_path):
    recorder = started(tmp_path)
    recorder.add(c.ROBOT_DESCRIPTION, URDF)
    recorder.add(c.CLOCK, clock(5))
    with pytest.raises(RefusedError, match=r"here/run\.mcap is being recorded: stop it first"):
        recorder.control(m.RecorderControl(action=START))
    assert not last_status(recorder.control(m.RecorderControl(action=STOP))).is_recording
    with pytest.raises(RefusedError, match="nothing is being recorded"):
        recorder.control(m.RecorderControl(action=STOP))
    recorder.add(c.CLOCK, clock(6))
    with pytest.raises(RefusedError, match=r"run is 'a/b', must be of letters, digits and _ . : -"):
        recorder.control(m.RecorderControl(action=START, run="a/b"))
    status = last_status(recorder.control(m.RecorderControl(action=START, run="second")))
    assert status.path == str(tmp_path / "second" / "run.mcap")
    recorder.add(c.CLOCK, clock(7))
    recorder.close()
    times_s, metadata = content(tmp_path / "second" / "run.mcap")
    assert times_s == {"/robot_description": [7.0], "/clock": [7.0]}, "what each file needs stands at its head"
    assert json.loads(metadata["hyrecro_counts"]["/clock"])["num_published"] == 1
    assert json.loads(metadata["hyrecro_counts"]["/robot_description"])["num_repeated"] == 1
    assert metadata["hyrecro_end"] == {"state": "COMPLETE", "reason": ""}
    assert set(content(tmp_path / "here" / "run.mcap")[0]) == {"/robot_description", "/clock", "/recorder/control"}


def test_a_run_that_exists_is_not_written_over(tmp_path):
    recorder = started(tmp_path)
    recorder.control(m.RecorderControl(action=STOP))
    with pytest.raises(RefusedError, match=r"run\.mcap: cannot record into it: File exists"):
        recorder.control(m.RecorderControl(action=START, run="here"))
    first = last_status(recorder.control(m.RecorderControl(action=START))).path
    recorder.control(m.RecorderControl(action=STOP))
    assert last_status(recorder.control(m.RecorderControl(action=START))).path != first
    recorder.close()


def test_a_choice_of_channels(tmp_path):
    recorder = started(tmp_path, channels=("map/*", "health/sim"))
    for channel, message in [(c.CLOCK, clock(0)), (c.MAP_CLOUD, cloud(1, 10))]:
        recorder.add(channel, message)
    for example in EXAMPLES:
        if isinstance(example, m.Health):
            recorder.add(c.HEALTH, example)
    recorder.control(m.RecorderControl(action=STOP))
    times_s, metadata = content(tmp_path / "here" / "run.mcap")
    assert set(times_s) == {"/map/cloud", "/health/sim"}
    assert metadata["hyrecro_run"]["channels"] == "map/* health/sim"
    with pytest.raises(RefusedError, match="channels: 'lidr/\\*' matches no recorded key"):
        recorder.control(m.RecorderControl(action=START, channels=("clock", "lidr/*")))
    recorder.control(m.RecorderControl(action=START, run="other", channels=("clock",)))
    recorder.add(c.CLOCK, clock(1))
    recorder.add(c.MAP_CLOUD, cloud(2, 10))
    recorder.close()
    assert set(content(tmp_path / "other" / "run.mcap")[0]) == {"/clock"}


def test_what_it_is_not_given_is_not_lost(tmp_path):
    recorder = started(tmp_path, channels=("tf",))
    assert {channel.key for channel in recorder.channels} == {"tf", "clock", "health/*"}
    recorder.control(m.RecorderControl(action=STOP))
    with pytest.raises(RefusedError, match="channels: 'lidar/\\*' matches no recorded key"):
        recorder.control(m.RecorderControl(action=START, channels=("lidar/*",)))
    recorder.control(m.RecorderControl(action=START, run="all", channels=("*",)))
    for last_seq in (0, 9):
        recorder.add(c.HEALTH, heartbeat_of_lidar(last_seq))
    status = last_status(recorder.close())
    assert not any(record.num_lost_on_bus for record in status.channels)
    assert state(tmp_path / "all" / "run.mcap") == "COMPLETE"


def test_a_configured_choice_that_is_none_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"recorder\.channels: 'x' matches no recorded key"):
        started(tmp_path, channels=("x",))


def test_it_waits_to_be_told_where_so_configured(tmp_path):
    recorder = started(tmp_path, starts=False)
    recorder.add(c.CLOCK, clock(0))
    status = last_status(recorder.tick())
    assert (status.is_recording, status.path, status.num_files, status.channels) == (False, "", 0, ())
    assert status.free_bytes > 0
    assert list(tmp_path.iterdir()) == []
    recorder.control(m.RecorderControl(action=START, run="later"))
    recorder.close()
    assert (tmp_path / "later" / "run.mcap").exists()


def test_files_follow_each_other_by_time_and_each_is_readable_by_itself(tmp_path):
    recorder = started(tmp_path, max_file_s=2.0)
    recorder.add(c.ROBOT_DESCRIPTION, URDF)
    for seq in (2, 3, 4, 5, 8):
        recorder.add(c.CLOCK, clock(seq))
    status = last_status(recorder.close())
    assert (status.num_files, status.path) == (3, str(tmp_path / "here" / "run_002.mcap"))
    files = [tmp_path / "here" / name for name in ("run.mcap", "run_001.mcap", "run_002.mcap")]
    assert [content(file)[0] for file in files] == [
        {"/robot_description": [1.5], "/clock": [2.0, 3.0]},
        {"/robot_description": [4.0], "/clock": [4.0, 5.0]},
        {"/robot_description": [8.0], "/clock": [8.0]},
    ]
    assert [counts(file, "/clock")["num_received"] for file in files] == [2, 2, 1]
    assert [counts(file, "/clock")["num_lost_on_bus"] for file in files] == [0, 0, 2]
    assert [state(file) for file in files] == ["COMPLETE", "COMPLETE", "INCOMPLETE"]
    assert [content(file)[1]["hyrecro_run"]["file"] for file in files] == ["0", "1", "2"]
    assert next(record for record in status.channels if record.key == "clock").num_received == 5
    assert Recording(files[1]).metadata["seed"] == "1"


def test_files_follow_each_other_by_size(tmp_path):
    recorder = started(tmp_path, max_file_mib=1, compression="none")
    for seq in range(10):
        recorder.add(c.MAP_CLOUD, cloud(seq, 40_000))  # half a MiB each; a chunk is one MiB
    status = last_status(recorder.close())
    files = sorted((tmp_path / "here").glob("run*.mcap"))
    assert (len(files), status.num_files) == (4, 4)
    assert status.num_bytes == sum(file.stat().st_size for file in files)
    assert sorted(time_s for file in files for time_s in content(file)[0]["/map/cloud"]) == list(map(float, range(10)))


def test_a_disk_that_fills_stops_the_recording_and_leaves_it_readable(tmp_path):
    recorder = started(tmp_path, compression="none", chunk_size_kib=64)
    with files_of_at_most(1_000_000):
        for seq in range(10):
            recorder.add(c.MAP_CLOUD, cloud(seq))  # 240 kB each, a chunk of its own
        wait_until(lambda: not last_status(recorder.tick()).is_recording, "the disk refuses")
    status = last_status(recorder.tick())
    assert "File too large" in status.text
    recorder.add(c.MAP_CLOUD, cloud(10))
    (record,) = last_status(recorder.close()).channels
    assert (record.num_received, record.num_written, record.num_lost_to_disk) == (11, 4, 7)
    times_s, metadata = content(tmp_path / "here" / "run.mcap")
    assert times_s == {"/map/cloud": [0.0, 1.0, 2.0, 3.0]}
    assert metadata["hyrecro_end"]["state"] == "INCOMPLETE"
    assert "File too large" in metadata["hyrecro_end"]["reason"]
    assert recorder.num_lost_to_disk() == {c.MAP_CLOUD.key_expr: 7}
    assert recorder.has_lost


def test_a_full_disk_is_said_once_and_a_new_run_begins_when_there_is_room(tmp_path):
    recorder = started(tmp_path, compression="none", chunk_size_kib=64)
    with files_of_at_most(1_000_000):
        for seq in range(10):
            recorder.add(c.MAP_CLOUD, cloud(seq))
        said = wait_until(lambda: events(recorder.tick()), "the disk refuses")
    assert [severity for severity, _ in said] == [m.Severity.ERROR]
    assert "the recording has stopped: " in said[0][1]
    assert events(recorder.tick()) == []
    with pytest.raises(RefusedError, match=r"nothing is being recorded: .*File too large"):
        recorder.control(m.RecorderControl(action=STOP))
    status = last_status(recorder.control(m.RecorderControl(action=START, run="again")))
    assert (status.is_recording, status.text, status.channels) == (True, "", ())
    recorder.add(c.MAP_CLOUD, cloud(11))
    recorder.close()
    assert content(tmp_path / "again" / "run.mcap")[0] == {"/map/cloud": [11.0]}


def test_room_is_kept_free(tmp_path):
    with pytest.raises(
        RecordingError, match=r"here: the disk has \d+ MiB left, recorder\.min_free_mib keeps 1048576 free"
    ):
        started(tmp_path, min_free_mib=1024 * 1024)
    recorder = started(tmp_path, min_free_mib=1024 * 1024, starts=False)
    with pytest.raises(RefusedError, match="the disk has"):
        recorder.control(m.RecorderControl(action=START, run="there"))


def test_what_finds_no_room_in_the_queue_is_lost_to_disk(tmp_path):
    series = FileSeries(tmp_path, [], {}, RecorderConfig(min_free_mib=0), {})
    writer = RunWriter(series, max_queue_bytes=2000, chunk_period_s=0.5)
    for seq, num_points in enumerate((10, 200, 10)):  # 12 bytes a point
        writer.put(to_record(c.MAP_CLOUD, cloud(seq, num_points), seq, number=0, num_missed=seq))
    assert writer.close(10.0)
    assert writer.num_received == {"map/cloud": 3}
    assert series.progress() == {"map/cloud": (2, 1)}
    assert counts(tmp_path / "run.mcap", "/map/cloud") == {
        "num_published": 6,
        "num_received": 3,
        "num_written": 2,
        "num_lost_on_bus": 3,
        "num_lost_to_disk": 1,
        "num_repeated": 0,
    }
    assert state(tmp_path / "run.mcap") == "INCOMPLETE"
