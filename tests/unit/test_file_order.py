"""Recordings read from their head on: whole, cut off, of another version, and what is none."""

import pytest
from mcap.writer import CompressionType, Writer

from services.recorder.bag.file_order import FileOrderReading
from services.recorder.ros.messages import to_cdr
from shared.errors import InputFileError
from shared.messaging.channels import CLOCK, LEG_STATE, LIDAR_IMU
from shared.messaging.messages import Clock, Foot, Imu, LegState

MAGIC = b"\x89MCAP0\r\n"
PERIOD_NS = 10_000_000
REAR_IMU = LIDAR_IMU.of_sensor("lidar_rear")


def clock(number):
    return Clock(stamp_ns=number * PERIOD_NS, seq=number, frame="")


def legs(number):
    pose = [0, 0, 0, 0, 0, 0, 1.0]
    return LegState(stamp_ns=number * PERIOD_NS, seq=number, frame="world", fixed_foot=Foot.A, T_world_foot=pose)


def imu(number):
    zeros = [0.0, 0.0, 0.0]
    values = {"angular_velocity_radps": zeros, "linear_acceleration_mps2": zeros}
    return Imu(stamp_ns=number * PERIOD_NS, seq=number, frame="lidar_rear", **values)


SAID = [(channel, make(number)) for number in range(100) for channel, make in ((CLOCK, clock), (LEG_STATE, legs))]
SAID.append((REAR_IMU, imu(100)))


@pytest.fixture
def path(tmp_path):
    return written(tmp_path / "run.mcap", [(channel, message, None) for channel, message in SAID])


def written(path, messages):
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1000, compression=CompressionType.LZ4)
        writer.start()
        ids = {}
        for channel, message, data in messages:
            if channel.topic not in ids:
                schema = writer.register_schema(channel.ros_type, "ros2msg", b"")
                ids[channel.topic] = writer.register_channel(channel.topic, "cdr", schema)
            encoded = bytes(to_cdr(message, message.stamp_ns)[1]) if data is None else data
            writer.add_message(ids[channel.topic], message.stamp_ns, encoded, message.stamp_ns, message.seq)
        writer.finish()
    return path


def everything(_channel, _stamp_ns):
    return True


def test_all_messages_come_in_the_order_of_the_file(path):
    reading = FileOrderReading(path)
    assert list(reading.messages(everything)) == SAID
    assert (reading.is_truncated, reading.num_unreadable) == (False, {})
    assert reading.num_read == reading.num_bytes == path.stat().st_size


def test_only_what_is_wanted_comes(path):
    wanted = list(FileOrderReading(path).messages(lambda channel, ns: channel is CLOCK and ns < 3 * PERIOD_NS))
    assert wanted == [(CLOCK, clock(number)) for number in range(3)]


def test_a_file_without_its_end_gives_its_whole_chunks(path):
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    reading = FileOrderReading(path)
    messages = list(reading.messages(everything))
    assert reading.is_truncated
    assert 20 < len(messages) < len(SAID)
    assert messages == SAID[: len(messages)]


def test_a_file_spoilt_in_a_chunk_gives_what_stands_before(path):
    spoilt = bytearray(path.read_bytes())
    middle = len(spoilt) // 2
    spoilt[middle : middle + 400] = b"\xff" * 400
    path.write_bytes(spoilt)
    reading = FileOrderReading(path)
    messages = list(reading.messages(everything))
    assert reading.is_truncated
    assert messages == SAID[: len(messages)]


def test_messages_of_another_version_are_left_out_and_counted(tmp_path):
    said = [(CLOCK, clock(0), None), (LEG_STATE, legs(1), b"\0\1\0\0abc"), (CLOCK, clock(2), None)]
    reading = FileOrderReading(written(tmp_path / "old.mcap", said))
    assert list(reading.messages(everything)) == [(CLOCK, clock(0)), (CLOCK, clock(2))]
    assert reading.num_unreadable == {"/leg/state": 1}


@pytest.mark.parametrize(
    ("content", "reason"), [(b"#, a text file", "is no MCAP file"), (b"", "ends before"), (None, "No such file")]
)
def test_what_is_no_recording_is_refused(tmp_path, content, reason):
    path = tmp_path / "x.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputFileError, match=f"{path}.*{reason}"):
        FileOrderReading(path)
