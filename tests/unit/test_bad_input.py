"""Bad input of every kind: it is read, or refused with one of the project's own errors. What was found stays found."""

import contextlib
import random
import struct
import tracemalloc
from pathlib import Path

import lz4.frame
import msgpack
import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings, strategies as st
from mcap.records import Chunk

from fuzz.examples import COMMANDS
from fuzz.mutations import damaged, payload_like
from fuzz.targets import TARGETS
from services.recorder.bag.recording import Recording
from services.recorder.ros.messages import to_cdr
from services.recorder.ros.reading import from_cdr
from services.sensors.sources.ros_recording import read_bag
from shared.errors import CodecError, ConfigError, InputFileError, MessageError
from shared.files import read_bytes, read_text
from shared.mcap_chunks import MAGIC, ChunkError, records_of
from shared.messaging import messages as m
from shared.messaging.channels import CHANNELS, LIDAR_POINTS
from shared.messaging.codec import decode, decode_command, encode, from_text, to_text
from shared.pcd_format import parse_pcd
from shared.runtime.config_loading import load_config
from shared.runtime.health import Traffic
from shared.world.files import load_structure
from shared.world.structure import unique_names
from shared.yaml_reading import YamlError, load_yaml
from tests.support.examples import EXAMPLES

MIB = 1024 * 1024
FEW = settings(max_examples=40, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
SLOW = {"beams", "config", "setting", "sweep"}
"""Which take tens of milliseconds a document."""


@pytest.mark.parametrize("name", sorted(set(TARGETS) - SLOW))
def test_damaged_examples_are_read_or_refused(name):
    """As `python -m fuzz` gives them, without its guidance; what else is raised fails here."""
    target, rng = TARGETS[name], random.Random(name)
    examples = target.examples()
    outcomes = {target.run(damaged(rng.choice(examples), rng)) for _ in range(60)}
    assert False in outcomes, "nothing was refused"


@pytest.mark.parametrize("name", sorted(SLOW))
def test_damaged_documents_are_read_or_refused(name):
    target, rng = TARGETS[name], random.Random(name)
    for example in target.examples()[:1]:
        assert not all(target.run(damaged(example, rng)) for _ in range(8))


@FEW
@given(data=st.binary(max_size=300))
@pytest.mark.parametrize("name", sorted(set(TARGETS) - SLOW))
def test_any_bytes_are_read_or_refused(name, data):
    TARGETS[name].run(data)


@FEW
@given(seed=st.integers(0, 2**32))
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: type(example).__name__)
def test_what_is_nearly_a_message_is_one_or_is_refused(example, seed):
    """What was read can be sent on, comes back the same, and can be recorded or is refused."""
    rng, message_type = random.Random(seed), type(example)
    is_command = message_type in COMMANDS
    payload = payload_like(example, rng, is_command=is_command)
    try:
        message = (decode_command if is_command else decode)(message_type, payload)
    except CodecError:
        return
    assert decode(message_type, encode(message)) == message
    if any(channel.message is message_type for channel in CHANNELS):
        with contextlib.suppress(MessageError):
            assert to_cdr(message, 0)


# ---- the codec


def test_a_list_is_not_made_before_its_items_are_there():
    """A thousand nested lists, each said to hold 65,000 items: 5 KB that took 80 MB."""
    payload = b"\x81\xa1q" + (b"\xdd" + struct.pack(">I", 65_000)) * 1000
    tracemalloc.start()
    with pytest.raises(CodecError, match="ends too early"):
        decode(m.PointCloud, payload)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < MIB


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b'{"q": [0], "duration_s": 1' + b"0" * 400 + b"}", "duration_s is a number too large"),
        (b'{"q": [0], "names": ["\\ud800"]}', "is not Unicode text: surrogates"),
        (b'{"q": [0], "q": [1]}', "'q' is given twice"),
        (b"\x82\xa1q\x91\x00\xa1q\x91\x01", "'q' is given twice"),
        (b"\x81\xc4\x01q\x91\x00", "a key of a map is no text"),
        (b'{"q": ' + b"[" * 5000 + b"]" * 5000 + b"}", "not JSON|list of numbers"),
    ],
)
def test_commands_that_took_a_service_down_or_meant_two_things(payload, reason):
    with pytest.raises(CodecError, match=reason):
        decode_command(m.JointTarget, payload)


def test_a_foreign_value_is_not_quoted_in_full():
    with pytest.raises(CodecError, match="foot is a list, must be one of A, B"):
        decode_command(m.LegTarget, msgpack.packb({"foot": [[["A"]]]}))


def test_what_the_zenoh_command_shows_and_sends_has_limits_too():
    key = "hyrecro/joints/target"
    for payload in (b"\x81\xc4\x01a\x01", b"x" * 70_000, b"\x81\xa1q" + b"\x91" * 990 + b"\x00"):
        with pytest.raises(CodecError):
            to_text(key, payload)
    with pytest.raises(CodecError, match="not Unicode text"):
        from_text("hyrecro/robot/stop", "\udcff")


# ---- numbers that are valid and extreme


@pytest.mark.parametrize(
    ("message_type", "fields", "reason"),
    [
        (m.ReplayControl, {"seek_s": 1e308}, "seek_s is 1e"),
        (m.ReplayControl, {"speed": 1e308}, "speed is 1e"),
        (m.FootTarget, {"point_m": [0.0, 0, 0], "normal": [1e308, 0, 0]}, "normal must be of length"),
        (m.FootTarget, {"point_m": [1e9, 0, 0], "normal": [0.0, 0, 1]}, "farther than"),
        (m.FootTarget, {"T_world_foot": [0, 0, 0, 1e308, 1e308, 0, 0]}, "quaternion of length inf"),
    ],
)
def test_extreme_commands(message_type, fields, reason):
    with pytest.raises(CodecError, match=reason):
        decode_command(message_type, msgpack.packb(fields))


def test_a_camera_has_pixels():
    at = {"stamp_ns": 0, "seq": 0, "frame": "", "fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0}
    for size in ({"height": -1, "width": 1}, {"height": 1, "width": 2**40}):
        with pytest.raises(MessageError, match="must be above 0 and at most"):
            m.CameraInfo(**at, **size)


def test_what_its_ros_type_cannot_hold_is_refused_by_name():
    plane = next(example for example in EXAMPLES if isinstance(example, m.Plane))
    fields = {name: getattr(plane, name) for name in ("id", "coefficients", "num_inliers", "outline_m")}
    huge = m.PlaneMap(stamp_ns=0, seq=0, frame="map", planes=(m.Plane(colour=[1e308, 0, 0], **fields),))
    with pytest.raises(MessageError, match="PlaneMap: hyrecro_msgs/msg/PlaneMap cannot hold it"):
        to_cdr(huge, 0)


def test_missed_messages_are_counted_up_to_the_largest_number():
    traffic = Traffic()
    for seq in (0, 2**63 - 1, 2**63 - 1):
        traffic.received("a", m.Clock(stamp_ns=0, seq=seq, frame=""))
    (count,) = traffic.snapshot({}, {}, {})
    assert count.num_missed == 2**63 - 1


def test_a_message_counts_as_received_or_as_refused():
    traffic = Traffic()
    clock = m.Clock(stamp_ns=0, seq=0, frame="")
    traffic.received("a", clock)
    traffic.received("a", clock)
    traffic.refused("a", is_message=True)
    traffic.refused("a")
    (count,) = traffic.snapshot({}, {}, {})
    assert (count.num_received, count.num_refused) == (1, 2)


# ---- files


@pytest.mark.parametrize("read", [read_text, read_bytes])
def test_a_file_beyond_its_limit_is_not_read(read, tmp_path):
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(3 * MIB)
    with pytest.raises(InputFileError, match=r"large: is 3 MiB, at most 2 MiB are read"):
        read(path, 2 * MIB)


def test_what_has_no_end_is_not_read():
    with pytest.raises(InputFileError, match="is more than 1 MiB, at most 1 MiB are read"):
        read_bytes(Path("/dev/zero"), MIB)


LAUGHS = "a: &a [x,x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (LAUGHS, "aliases make more than 1000000 values"),
        ("a: &a {<<: [" + "*a, " * 3 + "]}", "stands in itself"),
        ("&a [*a]", "stands in itself"),
        ("[" * 5000, "nested too deeply"),
        ("a: 2001-99-99", "month must be"),
        ("a: !!bool x", "not valid YAML"),
        ("!!int ''", "not valid YAML"),
    ],
)
def test_yaml_that_explodes_or_breaks_its_reader(text, reason, tmp_path):
    with pytest.raises(YamlError, match=reason):
        load_yaml(text, "x.yaml")
    path = tmp_path / "x.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=reason):
        load_config(path)
    with pytest.raises(InputFileError, match=reason):
        load_structure(path)


@pytest.mark.parametrize("setting", ["recorder.run=2001-99-99", "seed=" + "1" * 5000, "recorder\udcff=1"])
def test_a_setting_that_is_no_value(setting):
    with pytest.raises(ConfigError) as error:
        load_config(overrides=[setting])
    assert str(error.value).encode()


@pytest.mark.parametrize(("compression", "compress"), [("lz4", lz4.frame.compress), ("zstd", zstandard.compress)])
def test_a_chunk_gives_no_more_than_it_says(compression, compress):
    """A megabyte that would become gigabytes is one sentence long."""
    bomb = compress(bytes(64 * MIB))
    chunk = Chunk(compression, bomb, 0, 0, 0, 1000)
    tracemalloc.start()
    with pytest.raises(ChunkError, match="says it has 1000 bytes, and has another number"):
        records_of(chunk)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 2 * MIB
    with pytest.raises(ChunkError, match="at most"):
        records_of(Chunk(compression, bomb, 0, 0, 0, 2**50))


def test_a_record_longer_than_its_chunk_is_refused():
    data = struct.pack("<BQ", 5, 2**62) + b"abc"
    with pytest.raises(ChunkError, match="longer than its chunk"):
        records_of(Chunk("", data, 0, 0, 0, len(data)))


def test_recorded_bytes_that_are_no_message_are_one_kind_of_error():
    for data in (b"", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00" + b"\xff" * 60):
        with pytest.raises(MessageError):
            from_cdr(LIDAR_POINTS, data, 0)


def test_a_recording_whose_index_lies_is_refused(tmp_path):
    path = tmp_path / "run.mcap"
    example = TARGETS["mcap_in_time"].examples()[0]
    index = Recording(path := _written(path, example))._chunks[0]
    place = struct.pack("<QQ", index.chunk_start_offset, index.chunk_length)
    assert example.count(place) == 1
    for lie in (struct.pack("<QQ", 2**63, 2**63), struct.pack("<QQ", 20, 2**62)):
        with pytest.raises(InputFileError, match=r"run\.mcap: is damaged"):
            list(Recording(_written(path, example.replace(place, lie))).messages(LIDAR_POINTS))


def test_a_chunk_in_a_recording_of_others_that_says_it_has_more_than_there_can_be(tmp_path):
    content = struct.pack("<QQQIIQ", 0, 0, 0, 0, 0, 2**63)
    path = _written(tmp_path / "run.mcap", MAGIC + struct.pack("<BQ", 6, len(content)) + content)
    with pytest.raises(InputFileError, match=r"run\.mcap: not readable as a recording"):
        list(read_bag(path, "lidar", None, "lidar"))


def _written(path, data):
    path.write_bytes(data)
    return path


def test_points_that_would_be_more_than_is_read():
    header = b"FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 999999999\nHEIGHT 9\nDATA binary_compressed\n"
    with pytest.raises(ValueError, match="at most 1073741824 are read"):
        parse_pcd(header + np.array([4, 2**32 - 1], "<u4").tobytes())


def test_many_members_of_one_name_take_no_longer_each():
    names = unique_names(["bar"] * 50_000)
    assert (names[0], names[1], names[-1]) == ("bar", "bar_2", "bar_50000")
