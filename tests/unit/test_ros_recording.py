"""Recordings of ROS read back: what was written comes, and what cannot be used is said in one line."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from services.sensors.sources.ros_recording import read_bag
from shared.errors import InputFileError
from shared.messaging.messages import CameraInfo, DepthImage, Imu, LidarScan
from tests.support.bags import camera_info, cloud, image, imu, text, write_bag, write_mcap

STAMP_NS = 1_650_408_693_802_616_001
XYZ = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])


def points_m(i):
    return np.random.default_rng(i).uniform(1, 9, (20 + i, 3)).astype(np.float32)


def scan(i):
    return cloud(points_m(i).view(XYZ).reshape(-1), STAMP_NS + i)


LIDAR = [
    ("/chatter", text("hello")),
    ("/points", scan(0)),
    ("/imu", imu((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), STAMP_NS)),
    ("/points", scan(1)),
    ("/points", scan(2)),
]


def read(path, kind="lidar", topic=None):
    """All messages and how the recording ended."""
    recording, messages = read_bag(path, kind, topic, "the_frame"), []
    while True:
        try:
            messages.append(next(recording))
        except StopIteration as end:
            return messages, end.value


def check_lidar(messages):
    assert [type(message) for message in messages] == [LidarScan, Imu, LidarScan, LidarScan]
    scans = [message for message in messages if isinstance(message, LidarScan)]
    for i, message in enumerate(scans):
        assert (message.stamp_ns, message.seq, message.frame) == (STAMP_NS + i, i, "the_frame")
        np.testing.assert_array_equal(message.points_m, points_m(i))
    (reading,) = [message for message in messages if isinstance(message, Imu)]
    assert (reading.stamp_ns, reading.seq, reading.frame) == (STAMP_NS, 0, "the_frame")
    np.testing.assert_array_equal(reading.angular_velocity_radps, [1, 2, 3])
    np.testing.assert_array_equal(reading.linear_acceleration_mps2, [4, 5, 6])


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_rosbag2_folder(plugin, tmp_path):
    messages, ending = read(write_bag(tmp_path / "bag", plugin, LIDAR))
    check_lidar(messages)
    assert ending == ""


@pytest.mark.parametrize("options", [{}, {"chunk_bytes": 10**6}, {"use_index": False}])
def test_an_mcap_file(options, tmp_path):
    messages, ending = read(write_mcap(tmp_path / "run.mcap", LIDAR, **options))
    check_lidar(messages)
    assert ending == ""


def test_a_depth_camera(tmp_path):
    depth_mm = np.array([[0, 1, 2], [500, 65535, 6]], dtype=np.uint16)
    depth_m = np.array([[np.nan, -1.0, 0.0], [1.2344, 65.5351, np.inf]], dtype=np.float32)
    K = np.array([[10.0, 0, 1.5], [0, 11.0, 0.5], [0, 0, 1]])
    said = [
        ("/rgb/camera_info", camera_info(5, 5, K, STAMP_NS)),
        ("/rgb/image", image(np.zeros((5, 5), np.uint8), "mono8", STAMP_NS)),
        ("/depth/camera_info", camera_info(2, 3, K, STAMP_NS)),
        ("/depth/image", image(depth_mm, "16UC1", STAMP_NS)),
        ("/depth/image", image(depth_mm.astype(">u2"), "mono16", STAMP_NS + 1)),
        ("/depth/image", image(depth_m, "32FC1", STAMP_NS + 2)),
    ]
    messages, _ = read(write_mcap(tmp_path / "run.mcap", said), "depth")
    assert messages[0] == CameraInfo(
        stamp_ns=STAMP_NS, seq=0, frame="the_frame", height=2, width=3, fx=10.0, fy=11.0, cx=1.5, cy=0.5
    )
    expected = [depth_mm, depth_mm, [[0, 0, 0], [1234, 65535, 0]]]
    assert [type(message) for message in messages[1:]] == [DepthImage] * 3
    for i, (message, pixels) in enumerate(zip(messages[1:], expected, strict=True)):
        assert (message.seq, message.stamp_ns, message.height, message.width) == (i, STAMP_NS + i, 2, 3)
        np.testing.assert_array_equal(message.depth_mm.reshape(2, 3), pixels)


def test_a_topic_is_chosen_by_its_name(tmp_path):
    said = [("/front", scan(0)), ("/rear", scan(1)), ("/imu/a", LIDAR[2][1]), ("/imu/b", LIDAR[2][1])]
    path = write_mcap(tmp_path / "run.mcap", said)
    with pytest.raises(InputFileError, match=r"run.mcap: several topics .*: /front, /rear; --topic NAME chooses one"):
        read(path)
    (message,), _ = read(path, topic="/rear")
    np.testing.assert_array_equal(message.points_m, points_m(1))
    with pytest.raises(InputFileError, match=r"no topic /imu/a of sensor_msgs/msg/PointCloud2; it has /front \("):
        read(path, topic="/imu/a")


def test_no_suitable_topic(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", LIDAR)
    message = r"no topic of sensor_msgs/msg/Image; it has /chatter \(std_msgs/msg/String\), /imu \(sensor_msgs"
    with pytest.raises(InputFileError, match=message):
        read(path, "depth")


@pytest.mark.parametrize("use_index", [True, False])
def test_every_whole_chunk_of_a_cut_file(use_index, tmp_path):
    """Cut anywhere: a refusal before the first message, or what its whole chunks hold."""
    path = write_mcap(tmp_path / "run.mcap", LIDAR, use_index=use_index)
    data = path.read_bytes()
    num_read = []
    for num_bytes in [*range(200, len(data), 97), len(data) - 1]:
        path.write_bytes(data[:num_bytes])
        try:
            messages, ending = read(path)
        except InputFileError:
            num_read.append(0)
            continue
        assert ending == f"it is cut off after {num_bytes} bytes" or (ending == "" and len(messages) == 4)
        num_read.append(len(messages))
    assert sorted(num_read) == num_read
    assert set(num_read) == {0, 1, 2, 3, 4}


def test_a_damaged_chunk(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", LIDAR)
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(InputFileError, match=r"run.mcap: not readable as a recording: "):
        read(path)


@pytest.mark.parametrize("name", ["run.mcap", "run.db3", "run.bag", "run"])
@pytest.mark.parametrize("content", [b"", b"\x00" * 5000, b"\x89MCAP0\r\n", b"SQLite format 3\x00"])
def test_what_is_no_recording(name, content, tmp_path):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=f"{name}: "):
        read(path)


def test_what_is_not_there(tmp_path):
    with pytest.raises(InputFileError, match="nowhere: no such file"):
        read(tmp_path / "nowhere")
    with pytest.raises(InputFileError, match="not readable as a recording"):
        read(tmp_path)


def test_a_message_that_cannot_be_used(tmp_path):
    bad = scan(1)
    bad.point_step = 11
    path = write_mcap(tmp_path / "run.mcap", [("/points", scan(0)), ("/points", bad)])
    with pytest.raises(InputFileError, match=r"run.mcap: /points, message 2: its fields reach beyond"):
        read(path)
    path = write_mcap(tmp_path / "colour.mcap", [("/image", image(np.zeros((2, 2), np.uint8), "rgb8", STAMP_NS))])
    with pytest.raises(
        InputFileError, match=r"message 1: its encoding is rgb8; a depth image has 16UC1, mono16, 32FC1"
    ):
        read(path, "depth")
    path = write_mcap(tmp_path / "nan.mcap", [*LIDAR[:2], ("/imu", imu((np.nan, 0, 0), (0, 0, 0), 0))])
    with pytest.raises(InputFileError, match=r"/imu, message 1: angular_velocity_radps"):
        read(path)
