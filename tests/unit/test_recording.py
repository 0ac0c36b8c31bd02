from dataclasses import replace

import pytest

from services.recorder.bag.recording import Recording
from services.recorder.recorder import Recorder
from shared.errors import InputFileError
from shared.messaging.channels import CHANNELS, CLOCK, EVENTS, HEALTH, LEG_TARGET
from shared.messaging.messages import Clock, Event, Foot, Health, LegTarget
from shared.runtime.config import RecorderConfig
from tests.support.examples import EXAMPLES

BY_TYPE = {type(example): example for example in EXAMPLES}


def recorded(tmp_path, *pairs):
    recorder = Recorder(RecorderConfig(directory=tmp_path, run="here"), {"seed": "3"})
    recorder.start()
    for channel, message in pairs:
        recorder.add(channel, message)
    recorder.close()
    return Recording(tmp_path / "here" / "run.mcap")


READABLE = ["tf", "lidar/points", "map/cloud", "map/odometry", "map/status", "health/*"]
READABLE += ["joints/state", "leg/state", "lidar/imu", "depth/image", "depth/camera_info"]


@pytest.mark.parametrize("key", READABLE)
def test_messages_come_back_as_they_were(tmp_path, key):
    (channel,) = (channel for channel in CHANNELS if channel.key == key)
    message = BY_TYPE[channel.message]
    assert list(recorded(tmp_path, (channel, message)).messages(channel)) == [message]


def test_topics_metadata_and_duration(tmp_path):
    ticks = [(CLOCK, Clock(stamp_ns=k * 10**9, seq=k, frame="")) for k in (0, 1, 4)]
    recording = recorded(tmp_path, *ticks)
    (clock,) = (topic for topic in recording.topics() if topic.topic == "/clock")
    assert (clock.num_messages, clock.num_missed) == (3, 2)
    assert recording.metadata == {"seed": "3", "channels": "*", "file": "0"}
    assert recording.state == "INCOMPLETE"
    assert recording.duration_s == 4.0


def test_each_service_has_its_own_topic_of_health(tmp_path):
    recording = recorded(tmp_path, (HEALTH, BY_TYPE[Health]))
    assert "/health/sim" in {topic.topic for topic in recording.topics()}


def test_a_command_stands_at_the_newest_simulated_time(tmp_path):
    tick = Clock(stamp_ns=7 * 10**9, seq=0, frame="")
    recording = recorded(tmp_path, (CLOCK, tick), (LEG_TARGET, LegTarget(foot=Foot.B)))
    assert recording.duration_s == 0.0


def test_a_recording_begins_with_the_first_time_that_is_known(tmp_path):
    stamp_ns = 1_650_408_693_802_616_001
    early = [replace(BY_TYPE[Health], stamp_ns=0, seq=seq, service="mapper") for seq in range(3)]
    event = replace(BY_TYPE[Event], stamp_ns=0)
    later = replace(early[0], seq=3)
    tick = Clock(stamp_ns=stamp_ns, seq=0, frame="")
    recording = recorded(
        tmp_path, *((HEALTH, health) for health in early), (EVENTS, event), (CLOCK, tick), (HEALTH, later)
    )
    assert recording.duration_s == 0.0
    assert list(recording.messages(EVENTS)) == [replace(event, stamp_ns=stamp_ns, frame="")]
    healths = list(recording.messages(HEALTH))
    assert [(health.seq, health.stamp_ns) for health in healths] == [(seq, stamp_ns) for seq in range(4)]


def test_what_waits_for_a_time_that_never_comes_is_recorded_at_the_end(tmp_path):
    recording = recorded(tmp_path, (LEG_TARGET, LegTarget(foot=Foot.B)), (LEG_TARGET, LegTarget(foot=Foot.A)))
    (leg_target,) = (topic for topic in recording.topics() if topic.topic == "/leg/target")
    assert leg_target.num_messages == 2
    assert recording.duration_s == 0.0


@pytest.mark.parametrize("content", [b"", b"no recording", b"\x89MCAP0\r\n"])
def test_what_is_no_recording(tmp_path, content):
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=r"run\.mcap: not a complete recording"):
        Recording(path)
