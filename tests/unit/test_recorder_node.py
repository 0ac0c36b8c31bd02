"""The recorder's wiring: what it subscribes to, and what is declared in its file."""

import pytest

from cli.report import count_messages
from services.recorder.bag.recording import Recording
from services.recorder.node import build_node
from services.recorder.recorder import Recorder
from shared.messaging.channels import CHANNELS, channels_of
from shared.messaging.messages import LidarScan
from shared.runtime.config import RecorderConfig
from shared.runtime.config_loading import load_config
from shared.runtime.node import Context
from tests.support.examples import EXAMPLES

REAR = "sensors.others.lidar_rear={kind: lidar, frame: lidar_rear, mount: {}}"


@pytest.fixture
def node(tmp_path):
    config = load_config(overrides=[f"recorder.directory={tmp_path}", "recorder.run=here", REAR])
    node = build_node(config, Context(clock_ns=lambda: 0))
    node.on_start()
    yield node
    node.on_stop()


def test_it_subscribes_to_what_is_recorded_of_every_sensor(node):
    keys = {channel.key for channel in node.inputs}
    assert keys == {channel.key for channel in CHANNELS if channel.is_recorded} | {
        "lidar_rear/points",
        "lidar_rear/imu",
    }
    assert "depth/points" not in keys, "made only while someone subscribes: the recorder must not"


def test_it_subscribes_to_no_more_than_it_may_record(tmp_path):
    overrides = [f"recorder.directory={tmp_path}", "recorder.channels=[map/*]"]
    node = build_node(load_config(overrides=overrides), Context(clock_ns=lambda: 0))
    keys = {channel.key for channel in node.inputs}
    maps = {channel.key for channel in CHANNELS if channel.key.startswith("map/")}
    assert keys == maps | {"clock", "health/*", "recorder/control"}


def test_its_file_has_the_topics_of_every_sensor(node, tmp_path):
    node.on_stop()
    topics = {topic.topic for topic in Recording(tmp_path / "here" / "run.mcap").topics()}
    assert {"/lidar/points", "/lidar_rear/points", "/lidar_rear/imu", "/depth/image"} <= topics
    assert "/depth/points" not in topics


def test_the_report_counts_a_further_sensor_under_its_key(tmp_path):
    scan = next(example for example in EXAMPLES if type(example) is LidarScan)
    channels = channels_of(["lidar_rear"])
    (rear,) = (channel for channel in channels if channel.key == "lidar_rear/points")
    recorder = Recorder(RecorderConfig(directory=tmp_path, run="here"), {}, channels)
    recorder.start()
    recorder.add(rear, scan)
    recorder.close()
    counts = count_messages(Recording(tmp_path / "here" / "run.mcap"), ["lidar_rear"])
    assert counts["hyrecro/lidar_rear/points"]["received"] == 1
    assert counts["hyrecro/lidar/points"]["received"] == 0
