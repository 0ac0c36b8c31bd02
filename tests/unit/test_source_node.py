"""A recording in the place of each kind of sensor: its channels, its frame, and what does not go together."""

from pathlib import Path

import numpy as np
import pytest

from services.sensors.sources.node import SourceOptions, source_builder
from shared.errors import ConfigError, InputFileError
from shared.messaging.messages import DepthImage, Event, LidarScan
from shared.runtime.config import Config
from shared.runtime.node import Context
from tests.support.bags import camera_info, cloud, image, imu, write_mcap

STAMP_NS = 1_650_408_693_802_616_001
XYZ = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
REAR = {"kind": "lidar", "frame": "rear"}
CONFIG = Config.model_validate({"sensors": {"lidar": {"frame": "front"}, "others": {"lidar_rear": REAR}}})


@pytest.fixture
def mcap(tmp_path):
    said = [
        ("/points", cloud(np.ones(3, XYZ), STAMP_NS)),
        ("/imu", imu((0.0, 0.0, 0.0), (0.0, 0.0, 9.8), STAMP_NS)),
        ("/depth/image", image(np.ones((2, 2), np.uint16), "16UC1", STAMP_NS)),
        ("/depth/camera_info", camera_info(2, 2, np.eye(3), STAMP_NS)),
    ]
    return write_mcap(tmp_path / "run.mcap", said)


def built(sensor, *options):
    return source_builder(sensor, SourceOptions(*options))(
        CONFIG, Context(clock_ns=lambda: 0, is_wanted=lambda _channel: True)
    )


@pytest.mark.parametrize(
    ("sensor", "frame", "main", "keys"),
    [
        ("lidar", "front", LidarScan, ["lidar/points", "lidar/imu", "tf_static"]),
        ("lidar_rear", "rear", LidarScan, ["lidar_rear/points", "lidar_rear/imu"]),
        ("depth", "depth_optical", DepthImage, ["depth/image", "depth/camera_info", "depth/points", "depth/imu"]),
    ],
)
def test_a_sensor(mcap, sensor, frame, main, keys):
    node = built(sensor, mcap)
    assert node.name == sensor
    assert [channel.key for channel in node.outputs] == keys
    messages = list(node.on_timer())
    assert node.is_done()
    (measured,) = (message for message in messages if isinstance(message, main))
    assert measured.frame == frame
    channels = {channel.message for channel in node.outputs}
    assert {type(message) for message in messages} - {Event} <= channels
    assert node.on_stop() == []


def test_what_does_not_go_together(mcap):
    with pytest.raises(ConfigError, match="sensors: no sensor sonar; there are lidar, depth, lidar_rear"):
        built("sonar", mcap)
    with pytest.raises(InputFileError, match="--metadata belongs to a pcap"):
        built("lidar", mcap, Path("run.json"))
    for sensor, topic in (("depth", None), ("lidar", "/points")):
        with pytest.raises(InputFileError, match=r"run.pcap: a pcap is of a lidar, and has no topics"):
            built(sensor, Path("run.pcap"), None, topic)
