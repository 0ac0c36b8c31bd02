import json

import msgpack
import numpy as np
import pytest

from shared.errors import CodecError, MessageError
from shared.messaging.codec import decode, decode_command, encode, from_text, to_text
from shared.messaging.messages import Foot, JointTarget, LegTarget, LidarScan, PointCloud, Stop, Transforms


def test_bulk_arrays_travel_as_little_endian_bytes():
    cloud = PointCloud(stamp_ns=1, seq=2, frame="map", points_m=[[1.0, 2.0, 3.0]])
    assert msgpack.unpackb(encode(cloud))["points_m"] == np.array([1, 2, 3], dtype="<f4").tobytes()


def test_exact_bytes_of_a_small_command():
    assert encode(LegTarget(foot=Foot.B)) == b"\x81\xa4foot\xa1B"


@pytest.mark.parametrize("payload", [b"B", b" B\n", b'"B"', b'{"foot": "B"}', b"\x81\xa4foot\xa1B"])
def test_a_foot_in_every_spelling(payload):
    assert decode_command(LegTarget, payload) == LegTarget(foot=Foot.B)


@pytest.mark.parametrize(
    "payload", [b"[1, 2]", b'{"q": [1, 2]}', b'{"q":[1.0,2.0],"duration_s":null}', msgpack.packb({"q": [1, 2.0]})]
)
def test_joints_in_every_spelling(payload):
    assert decode_command(JointTarget, payload) == JointTarget(q=[1.0, 2.0])


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "1 to 65536 bytes"),
        (b"{", "not JSON"),
        (b"[" * 50_000, "not JSON"),
        (b'{"q": [1, NaN]}', r"q\[1\] is nan: must be finite"),
        (b'{"q": [1, true]}', "list of numbers"),
        (b'{"q": [[1], 2]}', "list of numbers"),
        (b'{"q": [1' + b"0" * 400 + b"]}", "too large"),
        (b'{"q": "half"}', "list of numbers"),
        (b'{"q": [1], "speed": 2}', "no field 'speed'"),
        (b'{"qq": [1]}', "did you mean q"),
        (b'{"q": [1], "duration_s": "long"}', "duration_s must be float"),
        (b'{"q": [1], "names": "q1"}', "names must be a list"),
        (b"\xff\xfe\x00", "neither MessagePack, JSON nor plain text"),
        (b"\x81\xa1q", "not one MessagePack value"),
        (b"\x81\xa1q\xc7\x01\x01\x00", "not one MessagePack value|list of numbers"),
        (b"x" * 70_000, "1 to 65536 bytes"),
    ],
)
def test_what_is_no_joint_target_is_refused_with_its_reason(payload, reason):
    with pytest.raises(CodecError, match=reason):
        decode_command(JointTarget, payload)


def test_a_length_that_lies_allocates_nothing():
    with pytest.raises(CodecError):
        decode(PointCloud, b"\x81\xa8points_m\xc6\xff\xff\xff\xff")


def test_columns_of_a_scan_must_have_one_length():
    columns = {"points_m": np.zeros((2, 3)), "intensity": [0, 0], "t_ns": [0, 0]}
    with pytest.raises(MessageError, match=r"ring must have shape \(N,\), got \(3,\) \(N is 2\)"):
        LidarScan(stamp_ns=0, seq=0, frame="l", ring=[0, 0, 0], **columns)


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [0, 0, 0, 1.1]])
def test_a_pose_has_a_unit_quaternion(quaternion):
    pose = [[1, 2, 3, 0, 0, 0, 1], [1, 2, 3, *quaternion]]
    with pytest.raises(MessageError, match="T_parent_child has a quaternion of length"):
        Transforms(stamp_ns=0, seq=0, frame="w", parents=("w", "w"), children=("a", "b"), T_parent_child=pose)


def test_edges_must_have_one_length():
    with pytest.raises(MessageError, match="same length"):
        Transforms(stamp_ns=0, seq=0, frame="world", parents=("world",), children=(), T_parent_child=np.eye(7)[6:])


def test_a_writable_array_of_the_sender_is_copied():
    points = np.zeros((2, 3), dtype=np.float32)
    cloud = PointCloud(stamp_ns=0, seq=0, frame="map", points_m=points)
    points[0, 0] = 5.0
    assert cloud.points_m[0, 0] == 0.0


def test_people_see_json_and_long_arrays_as_shapes():
    cloud = PointCloud(stamp_ns=0, seq=0, frame="map", points_m=np.zeros((100, 3)))
    assert json.loads(to_text("hyrecro/map/cloud", encode(cloud)))["points_m"] == "float32[100, 3]"
    assert json.loads(to_text("robot2/hyrecro/leg/target", b"B")) == "B"


def test_people_write_commands_as_json():
    assert decode_command(LegTarget, from_text("hyrecro/leg/target", "A")) == LegTarget(foot=Foot.A)
    with pytest.raises(CodecError, match="not a command key"):
        from_text("hyrecro/leg/state", "A")


@pytest.mark.parametrize("payload", [b"", b"{", b"[1", "\u00a1alto!".encode(), b"\xff" * 70_000, b'{"text": 3}'])
def test_a_stop_counts_whatever_its_bytes_are(payload):
    assert decode_command(Stop, payload) == Stop()


@pytest.mark.parametrize("payload", [b"stand back", b'"stand back"', b'{"text": "stand back"}'])
def test_a_stop_may_say_why(payload):
    assert decode_command(Stop, payload) == Stop(text="stand back")
