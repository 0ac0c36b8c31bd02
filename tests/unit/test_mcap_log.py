import contextlib
import dataclasses
import io
import resource
import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory

from services.recorder.disk import Output, RecordingError, new_file
from services.recorder.mcap_log import McapLog
from services.recorder.records import to_record
from services.recorder.ros.messages import ROS_FORMS
from shared.messaging import channels as c, messages as m
from tests.support.examples import EXAMPLES

RUN = {"hyrecro_run": {"version": "0.1.0", "seed": "5", "config": "mapper: {voxel_size_m: 0.1}\n"}}


def new_log(target, channels, **options):
    return McapLog(new_file(target) if isinstance(target, Path) else Output(target), channels, RUN, **options)


def write(log, channel, message, stamp_ns=0):
    stamp_ns = message.stamp_ns if isinstance(message, m.Measurement) else stamp_ns
    log.add(to_record(channel, message, stamp_ns, number=9))


def end(log):
    log.flush()
    log.close({"hyrecro_end": {"state": "COMPLETE"}})


def clock(seq, stamp_ns=None):
    return m.Clock(stamp_ns=seq * 10_000_000 if stamp_ns is None else stamp_ns, seq=seq, frame="world")


def event(source, seq):
    return m.Event(stamp_ns=seq, seq=seq, frame="", source=source, severity=m.Severity.INFO, text="x")


def cloud(seq, num_points):
    points_m = np.random.default_rng(seq).random((num_points, 3), np.float32)
    return m.PointCloud(stamp_ns=seq, seq=seq, frame="map", points_m=points_m)


def whole_chunks(data):
    """The log times of what can be read of a file that lacks its end."""
    reader = NonSeekingReader(io.BytesIO(data))
    times_ns = []
    with contextlib.suppress(McapError, ValueError, struct.error):  # where the file stops
        for _, _, record in reader.iter_messages(log_time_order=False):
            times_ns.append(record.log_time)
    return times_ns


@contextlib.contextmanager
def disk_of(num_bytes):
    """Lets the kernel refuse what goes beyond `num_bytes` in any file of this process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.mcap"


def test_every_recorded_message_can_be_read_back(path):
    by_type = {channel.message: channel.of("sim") for channel in c.CHANNELS}
    log = new_log(path, c.CHANNELS)
    sent = [example for example in EXAMPLES if type(example) in ROS_FORMS]
    for message in sent:
        write(log, by_type[type(message)], message, stamp_ns=2_000_000_000)
    end(log)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        read = {channel.topic: (schema, record) for schema, channel, record, _ in reader.iter_decoded_messages()}
    assert set(read) == {by_type[type(message)].topic for message in sent}
    for message in sent:
        schema, record = read[by_type[type(message)].topic]
        assert schema is not None
        stamp_ns = message.stamp_ns if isinstance(message, m.Measurement) else 2_000_000_000
        assert (schema.name, schema.encoding) == (by_type[type(message)].ros_type, "ros2msg")
        assert record.log_time == record.publish_time == stamp_ns
        assert record.sequence == (message.seq if isinstance(message, m.Measurement) else 9)


def test_the_head_and_the_end_have_their_metadata(path):
    log = new_log(path, [c.CLOCK])
    end(log)
    with path.open("rb") as file:
        metadata = {entry.name: entry.metadata for entry in make_reader(file).iter_metadata()}
    assert metadata == {**RUN, "hyrecro_end": {"state": "COMPLETE"}}


def test_what_is_in_whole_chunks_is_counted(path):
    log = new_log(path, [c.CLOCK])
    write(log, c.CLOCK, clock(0))
    log.add(dataclasses.replace(to_record(c.CLOCK, clock(1), 5, number=0), is_repeated=True))
    assert log.num_written["clock"] == 0
    log.flush()
    assert log.num_written["clock"] == 1
    end(log)


def test_a_key_of_many_services_becomes_a_topic_each(path):
    (health,) = [example for example in EXAMPLES if isinstance(example, m.Health)]
    log = new_log(path, c.CHANNELS)
    write(log, c.HEALTH.of("sim"), health)
    write(log, c.HEALTH.of("mapper"), health)
    end(log)
    with path.open("rb") as file:
        topics = {channel.topic for channel in make_reader(file).get_summary().channels.values()}
    assert {topic for topic in topics if topic.startswith("/health")} == {"/health/sim", "/health/mapper"}


def test_what_was_flushed_survives_a_killed_writer(path):
    log = new_log(path, c.CHANNELS)
    for seq in range(3):
        write(log, c.CLOCK, clock(seq))
    log.flush()
    write(log, c.CLOCK, clock(3))
    as_left_behind = path.read_bytes()
    assert whole_chunks(as_left_behind) == [0, 10_000_000, 20_000_000]
    assert log.num_bytes == len(as_left_behind)
    end(log)
    assert whole_chunks(path.read_bytes()) == [0, 10_000_000, 20_000_000, 30_000_000]


def test_a_chunk_closes_at_its_size_and_reaches_the_disk(path):
    log = new_log(path, [c.MAP_CLOUD], chunk_bytes=30_000)
    write(log, c.MAP_CLOUD, cloud(0, 1000))
    write(log, c.MAP_CLOUD, cloud(1, 1000))
    assert whole_chunks(path.read_bytes()) == []
    write(log, c.MAP_CLOUD, cloud(2, 1000))
    write(log, c.MAP_CLOUD, cloud(3, 1000))
    assert whole_chunks(path.read_bytes()) == [0, 1, 2]
    end(log)


def test_a_stream_that_takes_little_at_a_time_gets_everything():
    class Sluggish(io.BytesIO):
        def write(self, data):
            return super().write(bytes(data[:7]))

        def close(self):
            self.written = self.getvalue()
            super().close()

    stream = Sluggish()
    log = new_log(stream, [c.CLOCK])
    write(log, c.CLOCK, clock(4))
    end(log)
    times = [record.log_time for _, _, record in make_reader(io.BytesIO(stream.written)).iter_messages()]
    assert times == [40_000_000]


def test_every_whole_chunk_is_read_from_a_file_cut_anywhere(path):
    log = new_log(path, [c.CLOCK])
    sizes = []
    for seq in range(4):
        write(log, c.CLOCK, clock(seq))
        log.flush()
        sizes.append(log.num_bytes)
    end(log)
    data = path.read_bytes()
    for cut in range(sizes[0], len(data)):
        num_whole = sum(size <= cut for size in sizes)
        assert len(whole_chunks(data[:cut])) in (num_whole, num_whole + 1)  # a chunk may lack its index only


def test_flushing_nothing_writes_nothing(path):
    log = new_log(path, c.CHANNELS)
    size = log.num_bytes
    log.flush()
    assert log.num_bytes == size
    end(log)


def test_closing_twice_is_closing_once(path):
    log = new_log(path, [c.CLOCK])
    end(log)
    data = path.read_bytes()
    end(log)
    log.flush()
    assert path.read_bytes() == data
    with pytest.raises(RecordingError, match="closed"):
        write(log, c.CLOCK, clock(0))


def test_an_existing_file_is_never_overwritten(path):
    path.write_text("precious")
    with pytest.raises(RecordingError, match=r"run\.mcap: cannot record into it: File exists"):
        new_log(path, c.CHANNELS)
    assert path.read_text() == "precious"


def test_a_full_disk_ends_the_log_and_leaves_the_closed_chunks(path):
    log = new_log(path, [c.MAP_CLOUD], chunk_bytes=1)
    for seq in range(3):
        write(log, c.MAP_CLOUD, cloud(seq, 1000))
    size = log.num_bytes
    with disk_of(size + 5_000), pytest.raises(RecordingError, match=f"ended after {size} bytes: File too large"):
        write(log, c.MAP_CLOUD, cloud(3, 1000))
    data = path.read_bytes()
    assert len(data) == size
    assert whole_chunks(data) == [0, 1, 2]
    with pytest.raises(RecordingError, match="closed"):
        write(log, c.MAP_CLOUD, cloud(11, 1))
    log.close({"hyrecro_end": {"state": "INCOMPLETE"}})
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_summary().statistics.message_count == 3
        assert [record.log_time for _, _, record in reader.iter_messages()] == [0, 1, 2]
        assert [entry.name for entry in reader.iter_metadata()] == ["hyrecro_run", "hyrecro_end"]


def test_a_disk_without_room_for_the_next_chunk_is_left_alone(path):
    def check_room(num_bytes):
        if num_bytes > 5_000:
            raise RecordingError("no room")

    log = new_log(path, [c.CLOCK, c.MAP_CLOUD], chunk_bytes=1, check_room=check_room)
    write(log, c.CLOCK, clock(0))
    size = log.num_bytes
    with pytest.raises(RecordingError, match="no room"):
        write(log, c.MAP_CLOUD, cloud(1, 1000))
    assert log.num_bytes == len(path.read_bytes()) == size
    assert log.num_written == {"clock": 1}
    log.close()


def test_a_disk_full_at_the_end_leaves_the_closed_chunks(path):
    log = new_log(path, [c.CLOCK])
    write(log, c.CLOCK, clock(0))
    log.flush()
    with disk_of(log.num_bytes + 10), pytest.raises(RecordingError, match="File too large"):
        end(log)
    assert whole_chunks(path.read_bytes()) == [0]


def test_a_disk_full_at_the_start_is_said(path):
    with disk_of(10), pytest.raises(RecordingError, match="ended after 0 bytes"):
        new_log(path, [c.CLOCK])


def test_a_topic_keeps_its_type():
    other = c.Channel(
        key="other", message=m.LegTarget, delivery=c.EVERY, ros_type="std_msgs/msg/String", topic=c.CLOCK.topic
    )
    with pytest.raises(ValueError, match="/clock is recorded as rosgraph_msgs/msg/Clock, not as std_msgs/msg/String"):
        new_log(io.BytesIO(), [c.CLOCK, other])
