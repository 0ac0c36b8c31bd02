import dataclasses

import numpy as np
import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from services.recorder.ros.messages import ROS_FORMS, to_cdr
from services.recorder.ros.reading import from_cdr
from services.recorder.ros.schemas import OWN_DEFINITIONS, schema_text, typestore
from shared.errors import MessageError
from shared.messaging import messages as m
from shared.messaging.channels import CHANNELS, FOOT_TARGET, LIDAR_POINTS
from tests.support.examples import EXAMPLES

RECORDED = [example for example in EXAMPLES if type(example) in ROS_FORMS]
STAMP_NS = 12_345_678_901
AT = {"stamp_ns": STAMP_NS, "seq": 7}
POSE = np.array([1.0, -2.0, 0.5, 0.0, 0.6, 0.0, 0.8])


def decoded(message, stamp_ns=STAMP_NS):
    ros_type, data = to_cdr(message, stamp_ns)
    return typestore().deserialize_cdr(data, ros_type)


def decoded_from_schema_alone(message):
    ros_type, data = to_cdr(message, STAMP_NS)
    schema = Schema(id=1, name=ros_type, encoding="ros2msg", data=schema_text(ros_type).encode())
    decode = DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    return decode(bytes(data))


def stamp_of(header):
    return (header.stamp.sec, header.stamp.nanosec)


def assert_same(a, b):
    """Compares two decoders' views of one message, field by field."""
    if hasattr(a, "__dataclass_fields__"):
        names = [name for name in a.__dataclass_fields__ if name != "__msgtype__" and not name.isupper()]
        assert sorted(names) == sorted(b.__slots__)
        for name in names:
            assert_same(getattr(a, name), getattr(b, name))
    elif isinstance(a, list):
        assert len(a) == len(b)
        for of_a, of_b in zip(a, b, strict=True):
            assert_same(of_a, of_b)
    elif isinstance(a, np.ndarray):
        b = np.frombuffer(b, np.uint8) if isinstance(b, bytes) else np.asarray(b, a.dtype)
        np.testing.assert_array_equal(a, b)
    elif isinstance(b, bytes):
        assert bytes([a]) == b
    else:
        np.testing.assert_equal(a, b)


def test_every_recorded_channel_has_a_ros_form_of_the_type_it_names():
    forms = {channel.key: ROS_FORMS[channel.message].ros_type for channel in CHANNELS if channel.is_recorded}
    assert forms == {channel.key: channel.ros_type for channel in CHANNELS if channel.is_recorded}


def test_every_form_has_an_example():
    assert {type(example) for example in RECORDED} == set(ROS_FORMS)


@pytest.mark.parametrize("message", RECORDED, ids=lambda message: type(message).__name__)
def test_two_decoders_read_the_same(message):
    assert_same(decoded(message), decoded_from_schema_alone(message))


def test_cdr_begins_with_the_little_endian_encapsulation_header():
    ros_type, data = to_cdr(m.LegTarget(foot=m.Foot.B), 0)
    assert ros_type == "std_msgs/msg/String"
    assert bytes(data) == b"\x00\x01\x00\x00" + b"\x02\x00\x00\x00" + b"B\x00"


def test_a_command_is_stamped_with_its_receipt():
    target = decoded(m.JointTarget(q=np.array([0.1, -0.2]), names=("q1", "q4")))
    assert stamp_of(target.header) == (12, 345_678_901)
    assert target.name == ["q1", "q4"]
    assert target.position.tolist() == [0.1, -0.2]
    assert target.velocity.size == target.effort.size == 0


def test_a_joint_target_without_names_gets_them():
    assert decoded(m.JointTarget(q=np.zeros(8))).name == list(m.JOINT_NAMES)


def test_joint_state():
    state = m.JointState(**AT, frame="foot_a", q=np.arange(8.0), dq=np.arange(8.0) / 10)
    ros = decoded(state)
    assert (ros.header.frame_id, stamp_of(ros.header)) == ("foot_a", (12, 345_678_901))
    assert ros.name == ["q1", "q2", "q3", "q4", "q5", "q6", "q7", "q8"]
    np.testing.assert_array_equal(ros.position, np.arange(8.0))
    np.testing.assert_array_equal(ros.velocity, np.arange(8.0) / 10)
    assert ros.effort.size == 0
    with_effort = m.JointState(**AT, frame="foot_a", q=np.zeros(8), dq=np.zeros(8), effort=np.full(8, 22.7))
    np.testing.assert_array_equal(decoded(with_effort).effort, np.full(8, 22.7))


def test_leg_state_tells_unknown_from_zero():
    unknown = decoded(m.LegState(**AT, frame="world", fixed_foot=m.Foot.B, T_world_foot=POSE))
    assert (unknown.seq, unknown.fixed_foot) == (7, "B")
    assert (unknown.foot_pose.position.y, unknown.foot_pose.orientation.w) == (-2.0, 0.8)
    assert not unknown.is_contact_known
    assert np.isnan([unknown.load_n, unknown.margin]).all()
    known = decoded(
        m.LegState(
            **AT, frame="world", fixed_foot=m.Foot.A, T_world_foot=POSE, has_contact=False, load_n=0.0, margin=1.0
        )
    )
    assert (known.is_contact_known, known.has_contact, known.load_n, known.margin) == (True, False, 0.0, 1.0)


def test_transforms_keep_parent_child_and_quaternion_order():
    edges = m.Transforms(
        **AT,
        frame="world",
        parents=("world", "foot_a"),
        children=("foot_a", "hip"),
        T_parent_child=np.stack([POSE] * 2),
    )
    first, second = decoded(edges).transforms
    assert (first.header.frame_id, first.child_frame_id) == ("world", "foot_a")
    assert (second.header.frame_id, second.child_frame_id) == ("foot_a", "hip")
    t, q = second.transform.translation, second.transform.rotation
    assert (t.x, t.y, t.z) == (1.0, -2.0, 0.5)
    assert (q.x, q.y, q.z, q.w) == (0.0, 0.6, 0.0, 0.8)
    assert stamp_of(second.header) == (12, 345_678_901)


def test_clock_and_descriptions():
    assert decoded(m.Clock(**AT, frame="world")).clock.nanosec == 345_678_901
    urdf = "<robot name='hyrecro'/>"
    assert decoded(m.RobotDescription(**AT, frame="foot_a", urdf=urdf)).data == urdf
    assert decoded(m.StructureDescription(**AT, frame="world", urdf=urdf)).data == urdf


def test_a_scan_keeps_every_point_and_its_time():
    scan = m.LidarScan(
        **AT,
        frame="lidar",
        points_m=np.array([[1.0, 2.0, 3.0], [-4.0, 5.5, 0.25]], np.float32),
        intensity=np.array([0.5, 255.0], np.float32),
        t_ns=np.array([0, 4_000_000_000], np.uint32),
        ring=np.array([0, 127], np.uint16),
    )
    cloud = decoded(scan)
    assert (cloud.header.frame_id, cloud.height, cloud.width, cloud.is_dense) == ("lidar", 1, 2, True)
    assert (cloud.point_step, cloud.row_step, cloud.is_bigendian) == (22, 44, False)
    assert [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields] == [
        ("x", 0, 7, 1),
        ("y", 4, 7, 1),
        ("z", 8, 7, 1),
        ("intensity", 12, 7, 1),
        ("t", 16, 6, 1),
        ("ring", 20, 4, 1),
    ]
    second = cloud.data.tobytes()[22:]
    assert np.frombuffer(second[:16], "<f4").tolist() == [-4.0, 5.5, 0.25, 255.0]
    assert int.from_bytes(second[16:20], "little") == 4_000_000_000
    assert int.from_bytes(second[20:], "little") == 127


def test_a_scan_with_ground_truth_has_it_in_further_fields():
    (scan,) = [example for example in EXAMPLES if isinstance(example, m.LidarScan) and example.member is not None]
    cloud = decoded(scan)
    assert [(f.name, f.offset, f.datatype) for f in cloud.fields[5:]] == [
        ("ring", 20, 4),
        ("member", 24, 5),
        ("face", 28, 5),
        ("true_range_m", 32, 7),
    ]
    assert cloud.point_step == 36
    second = cloud.data.tobytes()[36:]
    assert np.frombuffer(second[24:32], "<i4").tolist() == [4, 5]
    assert np.frombuffer(second[32:], "<f4").tolist() == [3.0]
    partly = dataclasses.replace(scan, member=None, face=None)
    assert [f.name for f in decoded(partly).fields[6:]] == ["true_range_m"]


def test_scans_are_read_back_with_and_without_ground_truth():
    for scan in (example for example in EXAMPLES if isinstance(example, m.LidarScan)):
        _, data = to_cdr(scan, scan.stamp_ns)
        assert from_cdr(LIDAR_POINTS, bytes(data), scan.seq) == scan


def test_an_imu_says_that_it_knows_no_orientation():
    imu = m.Imu(
        **AT,
        frame="lidar",
        angular_velocity_radps=np.array([0.1, 0.2, 0.3]),
        linear_acceleration_mps2=np.array([1.0, 2.0, 9.81]),
    )
    ros = decoded(imu)
    assert (ros.header.frame_id, stamp_of(ros.header)) == ("lidar", (12, 345_678_901))
    assert ros.orientation_covariance.tolist() == [-1.0] + [0.0] * 8
    assert (ros.angular_velocity.x, ros.angular_velocity.y, ros.angular_velocity.z) == (0.1, 0.2, 0.3)
    assert (ros.linear_acceleration.x, ros.linear_acceleration.z) == (1.0, 9.81)


def test_a_depth_image_is_16uc1_and_leaves_ground_truth_out():
    depth_mm = np.array([0, 300, 301, 1000, 2999, 65_535], np.uint16)
    image = m.DepthImage(**AT, frame="depth_optical", height=2, width=3, depth_mm=depth_mm)
    ros = decoded(image)
    assert (ros.encoding, ros.height, ros.width, ros.step, ros.is_bigendian) == ("16UC1", 2, 3, 6, 0)
    assert ros.header.frame_id == "depth_optical"
    assert np.frombuffer(ros.data.tobytes(), "<u2").tolist() == depth_mm.tolist()
    true = dataclasses.replace(image, member=np.zeros(6), face=np.zeros(6), true_depth_m=np.ones(6))
    assert to_cdr(true, STAMP_NS)[1] == to_cdr(image, STAMP_NS)[1]


def test_camera_info_is_that_of_a_rectified_camera():
    info = m.CameraInfo(**AT, frame="depth_optical", height=480, width=848, fx=427.0, fy=428.0, cx=423.5, cy=239.5)
    ros = decoded(info)
    assert (ros.height, ros.width, ros.distortion_model, ros.d.tolist()) == (480, 848, "plumb_bob", [0.0] * 5)
    assert ros.k.tolist() == [427.0, 0.0, 423.5, 0.0, 428.0, 239.5, 0.0, 0.0, 1.0]
    assert ros.p.tolist() == [427.0, 0.0, 423.5, 0.0, 0.0, 428.0, 239.5, 0.0, 0.0, 0.0, 1.0, 0.0]
    assert ros.r.tolist() == np.eye(3).reshape(-1).tolist()


@pytest.mark.parametrize("num_points", [0, 3])
def test_a_map_cloud_is_xyz(num_points):
    points_m = np.arange(3.0 * num_points, dtype=np.float32).reshape(-1, 3)
    cloud = decoded(m.PointCloud(**AT, frame="map", points_m=points_m))
    assert (cloud.width, cloud.point_step, [f.name for f in cloud.fields]) == (num_points, 12, ["x", "y", "z"])
    np.testing.assert_array_equal(np.frombuffer(cloud.data.tobytes(), "<f4").reshape(-1, 3), points_m)


def test_odometry_says_what_it_does_not_know():
    ros = decoded(m.Odometry(**AT, frame="map", child_frame="lidar_estimated", T_frame_child=POSE))
    assert (ros.header.frame_id, ros.child_frame_id) == ("map", "lidar_estimated")
    assert (ros.pose.pose.position.x, ros.pose.pose.orientation.y) == (1.0, 0.6)
    assert not ros.pose.covariance.any()
    assert np.isnan(ros.twist.twist.linear.x)
    covariance = np.arange(36.0).reshape(6, 6)
    known = m.Odometry(**AT, frame="map", child_frame="lidar_estimated", T_frame_child=POSE, covariance=covariance)
    np.testing.assert_array_equal(decoded(known).pose.covariance, np.arange(36.0))


def test_own_types_copy_every_field():
    (status,) = [example for example in EXAMPLES if isinstance(example, m.MapStatus)]
    ros = decoded(status)
    copied = {name: getattr(ros, name) for name in m.MapStatus.__dataclass_fields__ if hasattr(ros, name)}
    assert copied | {"degenerate_axes": ("z",)} == {
        name: getattr(status, name) for name in m.MapStatus.__dataclass_fields__ if name not in ("stamp_ns", "frame")
    }
    (metrics,) = [example for example in EXAMPLES if isinstance(example, m.TrackingMetrics)]
    ros = decoded(metrics)
    assert (ros.seq, ros.num_poses, ros.ate_rmse_m, ros.rpe_rmse_m) == (7, 3, 0.002, 0.001)
    assert (ros.last_error_m, ros.last_error_rad, ros.rpe_rmse_rad, ros.drift_m) == (0.003, 0.001, 0.0005, 0.004)
    assert (ros.map_accuracy_mean_m, ros.map_accuracy_p95_m, ros.num_map_points) == (0.005, 0.011, 20_000)


def test_what_metrics_do_not_know_yet_is_nan():
    known = {"num_poses": 1, "ate_rmse_m": 0.0, "rpe_rmse_m": 0.0, "last_error_m": 0.0, "last_error_rad": 0.0}
    ros = decoded(m.TrackingMetrics(**AT, frame="map", **known))
    assert np.isnan([ros.rpe_rmse_rad, ros.drift_m, ros.map_accuracy_mean_m, ros.map_accuracy_p95_m]).all()
    assert ros.num_map_points == 0


@pytest.mark.parametrize(
    ("severity", "level"), [(m.Severity.INFO, 20), (m.Severity.WARNING, 30), (m.Severity.ERROR, 40)]
)
def test_events_keep_source_and_severity(severity, level):
    log = decoded(m.Event(**AT, frame="", source="sim", severity=severity, text="q1 is 3.0: limit is 1.57"))
    assert (log.level, log.name, log.msg) == (level, "sim", "q1 is 3.0: limit is 1.57")
    assert stamp_of(log) == (12, 345_678_901)


def test_health_lists_each_counter_of_each_key():
    count = m.ChannelCount(key="tf", num_sent=350, num_missed=2, last_seq=349, wait_max_s=0.5)
    (status,) = decoded(
        m.Health(**AT, frame="", service="sim", uptime_s=3.5, rss_bytes=50, busy_ratio=0.25, channels=(count,))
    ).status
    assert (status.name, status.level) == ("sim", 0)
    assert {pair.key: pair.value for pair in status.values} == {
        "uptime_s": "3.500",
        "rss_bytes": "50",
        "busy_ratio": "0.250",
        "cpu_ratio": "0.000",
        "num_open_files": "0",
        "num_threads": "0",
        "shared_memory_bytes": "0",
        "tf num_sent": "350",
        "tf num_bytes_sent": "0",
        "tf num_received": "0",
        "tf num_missed": "2",
        "tf num_dropped": "0",
        "tf num_refused": "0",
        "tf num_waiting": "0",
        "tf last_seq": "349",
        "tf wait_max_s": "0.5",
    }


def test_a_message_without_a_ros_form_is_refused_by_name():
    with pytest.raises(MessageError, match="ChannelCount has no ROS form"):
        to_cdr(m.ChannelCount(key="tf"), 0)


@pytest.mark.parametrize("stamp_ns", [-1, m.MAX_STAMP_NS + 1])
def test_a_stamp_that_is_no_ros_time_is_refused(stamp_ns):
    with pytest.raises(MessageError, match="stamp_ns"):
        to_cdr(m.Clock(stamp_ns=stamp_ns, seq=0, frame="world"), stamp_ns)
    assert decoded(m.Clock(**AT, frame="world"), m.MAX_STAMP_NS).clock.sec == 2**31 - 1


def test_schemas_contain_what_they_use():
    text = schema_text("hyrecro_msgs/msg/LegState")
    assert text.startswith(OWN_DEFINITIONS["hyrecro_msgs/msg/LegState"])
    assert "MSG: geometry_msgs/Quaternion\nfloat64 x" in text
    with pytest.raises(KeyError, match="no such ROS 2 type"):
        schema_text("hyrecro_msgs/msg/Leg")


LOST = {
    m.JointTarget: ("duration_s", "valid_s"),
    m.ActuatorTarget: ("duration_s",),
    m.FootTarget: ("foot", "point_m", "normal", "T_world_foot"),
    m.Clock: ("frame", "real_time_factor"),
}
"""What a ROS type has no place for."""


@pytest.mark.parametrize("message", RECORDED, ids=lambda message: type(message).__name__)
def test_every_message_can_be_read_back(message):
    channel = next(channel for channel in CHANNELS if channel.message is type(message))
    stamp_ns, seq = getattr(message, "stamp_ns", STAMP_NS), getattr(message, "seq", 0)
    _, data = to_cdr(message, stamp_ns)
    back = from_cdr(channel, bytes(data), seq, stamp_ns)
    for name in message.__dataclass_fields__:
        if name not in LOST.get(type(message), ()):
            np.testing.assert_equal(getattr(back, name), getattr(message, name))


def test_a_foot_target_comes_back_as_a_pose():
    target = m.FootTarget(foot=m.Foot.B, T_world_foot=POSE)
    back = from_cdr(FOOT_TARGET, bytes(to_cdr(target, 0)[1]), 0)
    assert (back.foot, back.point_m) == (None, None)
    np.testing.assert_array_equal(back.T_world_foot, POSE)
