"""A recording at its own pace, by times that are given."""

from collections.abc import Iterable

import numpy as np
import pytest

from services.sensors.sources.interface import Recording
from services.sensors.sources.playback import SourcePlayback
from services.sensors.sources.world import world_of_map
from shared.errors import InputFileError
from shared.messaging.messages import Event, Imu, LidarScan, Measurement, Severity

START_NS = 1_650_408_693_802_616_001
MS = 10**6


def scan(after_ms, seq=0):
    empty = {"points_m": np.empty((0, 3)), "intensity": np.empty(0), "t_ns": np.empty(0), "ring": np.empty(0)}
    dtypes = {"points_m": np.float32, "intensity": np.float32, "t_ns": np.uint32, "ring": np.uint16}
    arrays = {name: values.astype(dtypes[name]) for name, values in empty.items()}
    return LidarScan(stamp_ns=START_NS + after_ms * MS, seq=seq, frame="lidar", **arrays)


def imu(after_ms):
    zeros = {"angular_velocity_radps": np.zeros(3), "linear_acceleration_mps2": np.zeros(3)}
    return Imu(stamp_ns=START_NS + after_ms * MS, seq=0, frame="lidar", **zeros)


def recording(messages: Iterable[Measurement], ending: str = "") -> Recording:
    yield from messages
    return ending


def playback(*messages, ending=""):
    return SourcePlayback("run.mcap", "lidar", recording(messages, ending))


def stamps_ms(messages):
    return [(message.stamp_ns - START_NS) // MS for message in messages if not isinstance(message, Event)]


def test_messages_come_when_they_were_measured():
    played = playback(scan(0), scan(100), scan(200))
    now_ns = 12345
    assert stamps_ms(played.due(now_ns)) == [0]
    assert played.due(now_ns + 100 * MS - 1) == []
    assert stamps_ms(played.due(now_ns + 100 * MS)) == [100]
    assert not played.is_done
    *messages, event = played.due(now_ns + 300 * MS)
    assert stamps_ms(messages) == [200]
    assert played.is_done
    assert (event.severity, event.source, event.text) == (Severity.INFO, "lidar", "end of run.mcap: 3 scans")
    assert event.stamp_ns == START_NS + 200 * MS
    assert played.due(now_ns + 400 * MS) == []


def test_it_waits_some_seconds_for_somebody_to_listen():
    played = playback(scan(0), scan(100))
    assert played.due(0, is_wanted=False) == []
    assert played.due(2999 * MS, is_wanted=False) == []
    assert stamps_ms(played.due(2999 * MS, is_wanted=True)) == [0]
    assert stamps_ms(played.due(3099 * MS, is_wanted=False)) == [100]
    played = playback(scan(0))
    assert played.due(5, is_wanted=False) == []
    assert stamps_ms(played.due(3000 * MS + 5, is_wanted=False)) == [0]


def test_it_is_read_as_it_is_played():
    read = []

    def messages():
        try:
            for i in range(100):
                read.append(i)
                yield scan(i)
        finally:
            read.append("closed")
        return ""

    played = SourcePlayback("run.mcap", "lidar", messages())
    assert read == [0]
    played.due(0)
    assert read == [0, 1]
    assert len(played.due(60 * MS)) == 8
    assert stamps_ms(played.due(60 * MS)) == list(range(9, 17))
    played.close()
    assert read == [*range(18), "closed"]


def test_a_scan_is_stamped_at_its_first_point_and_comes_after_the_imu():
    played = playback(imu(50), scan(0), imu(150), scan(100))
    assert stamps_ms(played.due(0)) == [50, 0]
    assert stamps_ms(played.due(99 * MS)) == []
    *messages, event = played.due(100 * MS)
    assert stamps_ms(messages) == [150, 100]
    assert event.text == "end of run.mcap: 2 scans, 2 IMU readings"
    assert event.stamp_ns == START_NS + 150 * MS


def test_messages_from_before_are_dropped_and_said_once():
    played = playback(scan(0), scan(300), scan(100), imu(0), scan(200), scan(300), scan(250), scan(400))
    events = [message for message in played.due(0) if isinstance(message, Event)]
    assert events == []
    messages = played.due(400 * MS) + played.due(400 * MS)
    assert stamps_ms(messages) == [300, 0, 300, 400]
    texts = [(event.severity, event.text) for event in messages if isinstance(event, Event)]
    assert texts == [
        (Severity.ERROR, "run.mcap: time goes back by 0.200 s: scans are dropped until it has caught up"),
        (Severity.ERROR, "run.mcap: time goes back by 0.050 s: scans are dropped until it has caught up"),
        (Severity.INFO, "end of run.mcap: 4 scans, 1 IMU readings, 3 dropped"),
    ]
    assert played.num_dropped == 3


def test_how_it_ended_is_said():
    (_, event) = playback(scan(0), ending="it is cut off after 99 bytes").due(0)
    assert event.severity is Severity.WARNING
    assert event.text == "end of run.mcap: 1 scans, it is cut off after 99 bytes"


def test_nothing_to_play():
    with pytest.raises(InputFileError, match=r"run.mcap: it has no message to play, it is cut off"):
        playback(ending="it is cut off")
    with pytest.raises(InputFileError, match=r"run.mcap: it has no message to play$"):
        playback()


def test_the_map_is_the_world():
    played = SourcePlayback("run.mcap", "lidar", recording([scan(0), scan(100)]), world_of_map)
    frames, first = played.due(0)
    assert (frames.parents, frames.children, frames.stamp_ns) == (("world",), ("map",), START_NS - 200 * MS)
    np.testing.assert_array_equal(frames.T_parent_child, [[0, 0, 0, 0, 0, 0, 1]])
    assert first.stamp_ns == START_NS
    assert world_of_map(5).stamp_ns == 0
    assert stamps_ms(played.due(100 * MS)) == [100]
