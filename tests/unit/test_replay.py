import math
from dataclasses import replace

import pytest

from services.recorder.bag.recorded import Recorded, RecordingReader
from services.recorder.replay.channel_choice import chosen
from services.recorder.replay.lockstep import Lockstep, ReplayError
from services.recorder.replay.replay import Replay, ReplayOptions
from shared.errors import InputFileError, RefusedError
from shared.messaging import channels as c
from shared.messaging.messages import Clock, LidarScan, MapStatus, ReplayAction, ReplayControl
from tests.support.examples import EXAMPLES
from tests.support.recordings import CLOCK_HZ, NUM_SECONDS, SCAN_HZ, said, write_recording

NS = 10**9
LAST_NS = (NUM_SECONDS * CLOCK_HZ - 1) * NS // CLOCK_HZ
STATUS = next(example for example in EXAMPLES if isinstance(example, MapStatus))
CHANNELS = [c.ROBOT_DESCRIPTION, c.CLOCK, c.LIDAR_POINTS]


@pytest.fixture
def path(tmp_path):
    return write_recording(tmp_path / "run.mcap")


def replay_of(path, *, start_s=0.0, end_s=math.inf, lockstep=None, **options):
    options = ReplayOptions(
        first_ns=0,
        last_ns=LAST_NS,
        start_ns=round(start_s * NS),
        end_ns=min(LAST_NS, round(min(end_s, 1e6) * NS)),
        channels={channel: channel for channel in CHANNELS},
        **options,
    )
    return Replay(options, lambda: RecordingReader(path, CHANNELS.__contains__).messages(), lockstep)


def played(replay, now_s):
    """All that is given out by then."""
    messages = []
    while sent := replay.due(round(now_s * NS)):
        messages += [(sent.channel, sent.message) for sent in sent]
    return messages


def seconds(messages, kind=Clock):
    return [message.stamp_ns / NS for _, message in messages if isinstance(message, kind)]


def test_everything_comes_in_its_order_when_it_is_due(path):
    replay = replay_of(path)
    messages = played(replay, 100)
    assert seconds(messages) == [0.0], "time begins with the first call"
    for tick in range(1, NUM_SECONDS * CLOCK_HZ):
        assert seconds(played(replay, 100 + (tick - 0.5) / CLOCK_HZ)) == []
        now = played(replay, 100 + (tick + 0.01) / CLOCK_HZ)
        assert seconds(now) == [tick / CLOCK_HZ]
        assert len(now) == 1 + (tick % 2 == 0), "a scan comes when it was complete, not at its stamp"
        messages += now
    assert replay.is_done
    assert messages == [(channel, message) for channel, message in said() if channel in CHANNELS]
    assert replay.num_sent == len(messages)


def test_speed(path):
    replay = replay_of(path, speed=4.0)
    played(replay, 0)
    messages = played(replay, 0.5)
    assert seconds(messages)[-1] == 2.0
    assert {message.real_time_factor for _, message in messages if isinstance(message, Clock)} == {4.0}
    replay.control(ReplayControl(speed=1.0))
    played(replay, 0.5)
    assert seconds(played(replay, 1.0))[-1] == 2.5


def test_a_part_begins_with_what_was_kept(path):
    replay = replay_of(path, start_s=2.0, end_s=3.0, speed=None)
    messages = played(replay, 0)
    assert [channel.key for channel, _ in messages[:2]] == ["robot_description", "clock"]
    assert seconds(messages)[0] == 1.95, "the clock that was last said before"
    assert (seconds(messages)[1], seconds(messages)[-1]) == (2.0, 3.0)
    assert replay.is_done


def test_a_loop_begins_again_and_is_never_done(path):
    replay = replay_of(path, end_s=1.0, is_looping=True)
    played(replay, 0)
    assert seconds(played(replay, 1.0))[-2:] == [1.0, 0.0]
    assert seconds(played(replay, 1.51))[-1] == 0.5
    assert not replay.is_done


def test_pause_step_seek_resume(path):
    replay = replay_of(path, is_paused=True)
    assert seconds(played(replay, 0)) == [0.0]
    assert played(replay, 50) == []
    replay.control(ReplayControl(action=ReplayAction.STEP))
    assert seconds(played(replay, 50)) == [0.05, 0.1]
    replay.control(ReplayControl(seek_s=3.0))
    assert seconds(played(replay, 50)) == [2.95, 3.0]
    assert not replay.is_done
    replay.control(ReplayControl(action=ReplayAction.RESUME))
    played(replay, 60)
    assert seconds(played(replay, 60.51))[-1] == 3.5
    replay.control(ReplayControl(action=ReplayAction.PAUSE))
    assert played(replay, 70) == []
    assert replay.progress == pytest.approx(3.5 / (LAST_NS / NS))
    with pytest.raises(RefusedError, match=r"seek_s is 9, the recording has 4\.95 s"):
        replay.control(ReplayControl(seek_s=9.0))


def test_what_cannot_be_decoded_is_left_out_and_said():
    broken = Recorded(c.CLOCK, 0, 0, 0, b"\x00\x01\x00\x00\x05")
    options = ReplayOptions(first_ns=0, last_ns=0, start_ns=0, end_ns=0, channels={c.CLOCK: c.CLOCK})
    replay = Replay(options, lambda: iter([broken]))
    assert replay.due(0) == []
    assert replay.is_done
    assert "/clock, message 0: not readable" in replay.unreadable[0]


def status(scan_seq):
    return replace(STATUS, scan_seq=scan_seq)


def test_in_lockstep_a_scan_waits_for_the_answer_to_the_one_before(path):
    replay = replay_of(path, speed=None, lockstep=Lockstep(c.LIDAR_POINTS, frozenset({3, 7})))
    first = played(replay, 0)
    assert [message.seq for _, message in first if isinstance(message, LidarScan)] == [3]
    assert seconds(first)[-1] == 8 / SCAN_HZ, "what comes before the next scan does not wait"
    replay.add_status(status(2))
    assert played(replay, 1) == []
    replay.add_status(status(3))
    second = played(replay, 2)
    assert [message.seq for _, message in second if isinstance(message, LidarScan)] == [7]
    assert seconds(second)[-1] == LAST_NS / NS
    assert not replay.is_done
    with pytest.raises(ReplayError, match="no map/status of scan 7 within 30 s: is a mapper running"):
        replay.due(40 * NS)
    replay.add_status(status(7))
    assert replay.is_done


RECORDED = [c.CLOCK, c.TF, c.LIDAR_POINTS, c.LIDAR_IMU, c.MAP_STATUS, c.HEALTH.of("sim"), c.JOINTS_TARGET]


def keys(channels):
    return {channel.key: output.key for channel, output in channels.items()}


def test_commands_and_heartbeats_are_replayed_only_where_asked_for():
    assert set(keys(chosen(RECORDED, [], []))) == {"clock", "tf", "lidar/points", "lidar/imu", "map/status"}
    assert "joints/target" in keys(chosen(RECORDED, [], [], with_commands=True))
    assert set(keys(chosen(RECORDED, ["health/*"], []))) == {"health/sim"}
    with pytest.raises(InputFileError, match="no channel 'joints/target'"):
        chosen(RECORDED, ["joints/target"], [])


def test_mapped_again_means_without_the_map_of_then():
    again = chosen(RECORDED, [], [], is_mapped_again=True)
    assert set(keys(again)) == {"clock", "tf", "lidar/points", "lidar/imu"}


def test_renames():
    renamed = chosen(RECORDED, ["tf", "lidar/*"], ["tf=truth/tf", "lidar=lidar_rear"])
    assert keys(renamed) == {
        "tf": "truth/tf",
        "lidar/points": "lidar_rear/points",
        "lidar/imu": "lidar_rear/imu",
    }
    assert renamed[c.TF].topic == "/truth/tf"


@pytest.mark.parametrize("rename", ["tf", "=a", "tf=", "nothing=a", "lid=a"])
def test_bad_renames(rename):
    with pytest.raises(InputFileError, match="must be FROM=TO"):
        chosen(RECORDED, [], [rename])


def test_two_channels_of_one_name():
    with pytest.raises(InputFileError, match="two channels would be called clock"):
        chosen(RECORDED, [], ["tf=clock"])


def test_nothing_left():
    with pytest.raises(InputFileError, match="nothing is left to replay of health/sim"):
        chosen([c.HEALTH.of("sim")], [], [])
