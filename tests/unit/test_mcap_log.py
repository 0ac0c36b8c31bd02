import contextlib
import io
import json
import resource
import struct

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory

from services.recorder.mcap_log import COUNTS_METADATA, RUN_METADATA, McapLog, RecordingError
from services.recorder.ros_messages import ROS_FORMS
from shared.errors import MessageError
from shared.messaging import channels as c, messages as m
from tests.support.examples import EXAMPLES

RUN = {"version": "0.1.0", "seed": "5", "config": "mapper: {voxel_size_m: 0.1}\n"}


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
    log = McapLog(path, c.CHANNELS, RUN)
    sent = [example for example in EXAMPLES if type(example) in ROS_FORMS]
    for message in sent:
        log.write(by_type[type(message)], message, received_ns=2_000_000_000)
    log.close()
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
        num_sent = sum(type(other) is type(message) for other in sent)
        assert record.sequence == (message.seq if isinstance(message, m.Measurement) else num_sent)


def test_the_run_and_the_counts_are_stored(path):
    log = McapLog(path, [c.CLOCK, c.EVENTS], RUN)
    for seq in (3, 4, 7, 0, 2):  # 5 and 6 are missed; the publisher starts again and 1 is missed
        log.write(c.CLOCK, clock(seq, stamp_ns=50), 50)
    log.close()
    with path.open("rb") as file:
        metadata = {entry.name: entry.metadata for entry in make_reader(file).iter_metadata()}
    assert metadata[RUN_METADATA] == RUN
    assert {topic: json.loads(text) for topic, text in metadata[COUNTS_METADATA].items()} == {
        "/clock": {"num_received": 5, "num_missed": 3, "num_restarts": 1},
        "/events": {"num_received": 0, "num_missed": 0, "num_restarts": 0},
    }


def test_a_publisher_that_starts_again_at_the_same_number_is_noticed():
    log = McapLog(io.BytesIO(), [c.CLOCK], RUN)
    log.write(c.CLOCK, clock(0), 0)
    log.write(c.CLOCK, clock(0), 0)
    counts = log.counts["/clock"]
    assert (counts.num_received, counts.num_missed, counts.num_restarts) == (2, 0, 1)


def test_services_that_share_a_key_are_counted_apart():
    log = McapLog(io.BytesIO(), [c.EVENTS], RUN)
    for source, seq in [("sim", 5), ("mapper", 0), ("sim", 6), ("mapper", 2)]:
        log.write(c.EVENTS, event(source, seq), 0)
    counts = log.counts["/events"]
    assert (counts.num_received, counts.num_missed, counts.num_restarts) == (4, 1, 0)


def test_a_key_of_many_services_becomes_a_topic_each(path):
    (health,) = [example for example in EXAMPLES if isinstance(example, m.Health)]
    log = McapLog(path, c.CHANNELS, RUN)
    assert not any(topic.startswith("/health") for topic in log.counts)
    log.write(c.HEALTH.of("sim"), health, 0)
    log.write(c.HEALTH.of("mapper"), health, 0)
    log.close()
    assert {topic for topic in log.counts if topic.startswith("/health")} == {"/health/sim", "/health/mapper"}


def test_kept_messages_from_before_the_start_are_logged_at_it(path):
    log = McapLog(path, [c.CLOCK], RUN, start_ns=1_000)
    log.write(c.CLOCK, clock(0, stamp_ns=10), 2_000)
    log.write(c.CLOCK, clock(1, stamp_ns=1_500), 2_000)
    log.close()
    with path.open("rb") as file:
        times = [(record.log_time, record.publish_time) for _, _, record in make_reader(file).iter_messages()]
    assert times == [(1_000, 10), (1_500, 1_500)]


def test_what_was_flushed_survives_a_killed_writer(path):
    log = McapLog(path, c.CHANNELS, RUN)
    for seq in range(3):
        log.write(c.CLOCK, clock(seq), 0)
    log.flush()
    log.write(c.CLOCK, clock(3), 0)
    as_left_behind = path.read_bytes()
    assert whole_chunks(as_left_behind) == [0, 10_000_000, 20_000_000]
    assert log.num_bytes == len(as_left_behind)
    log.close()
    assert whole_chunks(path.read_bytes()) == [0, 10_000_000, 20_000_000, 30_000_000]


def test_a_chunk_closes_at_its_size_and_reaches_the_disk(path):
    log = McapLog(path, [c.MAP_CLOUD], RUN, chunk_bytes=30_000)
    log.write(c.MAP_CLOUD, cloud(0, 1000), 0)
    log.write(c.MAP_CLOUD, cloud(1, 1000), 0)
    assert whole_chunks(path.read_bytes()) == []
    log.write(c.MAP_CLOUD, cloud(2, 1000), 0)
    log.write(c.MAP_CLOUD, cloud(3, 1000), 0)
    assert whole_chunks(path.read_bytes()) == [0, 1, 2]
    log.close()


def test_a_stream_that_takes_little_at_a_time_gets_everything():
    class Sluggish(io.BytesIO):
        def write(self, data):
            return super().write(bytes(data[:7]))

        def close(self):
            self.written = self.getvalue()
            super().close()

    stream = Sluggish()
    log = McapLog(stream, [c.CLOCK], RUN)
    log.write(c.CLOCK, clock(4), 0)
    log.close()
    times = [record.log_time for _, _, record in make_reader(io.BytesIO(stream.written)).iter_messages()]
    assert times == [40_000_000]


def test_every_whole_chunk_is_read_from_a_file_cut_anywhere(path):
    log = McapLog(path, [c.CLOCK], RUN)
    sizes = []
    for seq in range(4):
        log.write(c.CLOCK, clock(seq), 0)
        log.flush()
        sizes.append(log.num_bytes)
    log.close()
    data = path.read_bytes()
    for cut in range(sizes[0], len(data)):
        num_whole = sum(size <= cut for size in sizes)
        assert len(whole_chunks(data[:cut])) in (num_whole, num_whole + 1)  # a chunk may lack its index only


def test_flushing_nothing_writes_nothing(path):
    log = McapLog(path, c.CHANNELS, RUN)
    size = log.num_bytes
    log.flush()
    assert log.num_bytes == size
    log.close()


def test_closing_twice_is_closing_once(path):
    log = McapLog(path, [c.CLOCK], RUN)
    log.close()
    data = path.read_bytes()
    log.close()
    log.flush()
    assert path.read_bytes() == data
    assert not log.is_open
    with pytest.raises(RecordingError, match="closed"):
        log.write(c.CLOCK, clock(0), 0)


def test_an_existing_file_is_never_overwritten(path):
    path.write_text("precious")
    with pytest.raises(RecordingError, match=r"run\.mcap: cannot record into it: File exists"):
        McapLog(path, c.CHANNELS, RUN)
    assert path.read_text() == "precious"


def test_a_full_disk_ends_the_log_and_leaves_the_closed_chunks(path):
    log = McapLog(path, [c.MAP_CLOUD], RUN, chunk_bytes=1)
    for seq in range(3):
        log.write(c.MAP_CLOUD, cloud(seq, 1000), 0)
    size = log.num_bytes
    with disk_of(size + 5_000), pytest.raises(RecordingError, match=f"ended after {size} bytes: File too large"):
        log.write(c.MAP_CLOUD, cloud(3, 1000), 0)
    assert not log.is_open
    data = path.read_bytes()
    assert len(data) == size
    assert whole_chunks(data) == [0, 1, 2]
    with pytest.raises(RecordingError, match="closed"):
        log.write(c.MAP_CLOUD, cloud(11, 1), 0)
    log.close()
    assert path.read_bytes() == data


def test_a_disk_full_at_the_end_leaves_the_closed_chunks(path):
    log = McapLog(path, [c.CLOCK], RUN)
    log.write(c.CLOCK, clock(0), 0)
    log.flush()
    with disk_of(log.num_bytes + 10), pytest.raises(RecordingError, match="File too large"):
        log.close()
    assert whole_chunks(path.read_bytes()) == [0]


def test_a_disk_full_at_the_start_is_said(path):
    with disk_of(10), pytest.raises(RecordingError, match="ended after 0 bytes"):
        McapLog(path, [c.CLOCK], RUN)


def test_a_message_of_another_type_is_refused_and_not_counted():
    log = McapLog(io.BytesIO(), [c.CLOCK], RUN)
    with pytest.raises(MessageError, match="clock carries Clock, not Event"):
        log.write(c.CLOCK, event("sim", 0), 0)
    with pytest.raises(MessageError, match="stamp_ns"):
        log.write(c.CLOCK, clock(0, stamp_ns=-1), 0)
    assert log.counts["/clock"].num_received == 0


def test_a_topic_keeps_its_type():
    other = c.Channel(
        key="other", message=m.LegTarget, delivery=c.EVERY, ros_type="std_msgs/msg/String", topic=c.CLOCK.topic
    )
    with pytest.raises(ValueError, match="/clock is recorded as rosgraph_msgs/msg/Clock, not as std_msgs/msg/String"):
        McapLog(io.BytesIO(), [c.CLOCK, other], RUN)
