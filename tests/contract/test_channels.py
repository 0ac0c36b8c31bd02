"""Every channel: unique, complete, and the only place where keys are written."""

import dataclasses
import re
from pathlib import Path

import pytest

from shared.messaging.channels import (
    CHANNELS,
    DEPTH_POINTS,
    LIDAR_POINTS,
    PREFIX,
    SENSOR_CHANNELS,
    TF,
    Delivery,
    channel_of_key,
    channels_of,
    sensor_channels,
)
from shared.messaging.messages import Measurement
from tests.support.examples import EXAMPLES

ROOT = Path(__file__).parents[2]


def test_keys_and_topics_are_unique():
    assert len({channel.key for channel in CHANNELS}) == len(CHANNELS)
    assert len({channel.topic for channel in CHANNELS}) == len(CHANNELS)


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda channel: channel.key)
def test_each_channel_is_complete(channel):
    concrete = channel.of("sim")
    assert channel_of_key(concrete.key_expr) == concrete
    assert channel_of_key("robot2/" + concrete.key_expr) == concrete, "a namespace may stand before the key"
    assert channel.message in {type(example) for example in EXAMPLES}
    assert channel.is_command != issubclass(channel.message, Measurement), (
        "commands count from receipt, the rest is stamped"
    )
    assert channel.delivery is Delivery.EVERY or channel.rate_hz, "only a stream may be dropped"


def test_a_further_sensor_has_the_channels_of_its_kind_under_its_name():
    rear = channel_of_key("hyrecro/lidar_rear/points")
    assert rear == dataclasses.replace(LIDAR_POINTS, key="lidar_rear/points", topic="/lidar_rear/points")
    assert channel_of_key("fleet/robot2/hyrecro/lidar_rear/points") == rear
    assert rear in channels_of(["lidar_rear"])
    points = channel_of_key("hyrecro/depth_left_2/points")
    assert (points.message, points.is_recorded) == (DEPTH_POINTS.message, False)


def test_the_table_grows_by_the_further_sensors_that_are_configured():
    assert channels_of() == CHANNELS
    more = channels_of(["lidar_rear", "depth_left"])
    assert more[: len(CHANNELS)] == CHANNELS
    assert [channel.key for channel in more[len(CHANNELS) :]] == [
        "lidar_rear/points",
        "lidar_rear/imu",
        "depth_left/image",
        "depth_left/camera_info",
        "depth_left/points",
        "depth_left/imu",
    ]
    assert len({channel.topic for channel in more}) == len(more)


@pytest.mark.parametrize("kind", SENSOR_CHANNELS)
def test_the_two_default_sensors_are_in_the_table(kind):
    assert sensor_channels(kind) == SENSOR_CHANNELS[kind]
    assert set(sensor_channels(kind)) <= set(CHANNELS)


@pytest.mark.parametrize("name", ["sonar_rear", "lidar_", "lidar_Rear", "lidar_a/b", "", "rear"])
def test_a_sensor_of_no_kind_is_refused(name):
    with pytest.raises(ValueError, match="kinds are lidar, depth"):
        channels_of([name])


@pytest.mark.parametrize(
    "key",
    [
        "",
        "hyrecro/",
        "hyrecro/nothing",
        "hyrecro/health/",
        "hyrecro/health/a/b",
        "leg/state",
        "hyrecro/lidar_rear",
        "hyrecro/lidar_rear/image",
        "hyrecro/lidar_/points",
        "hyrecro/lidar_rear/points/x",
        "hyrecro/sonar_rear/points",
    ],
)
def test_other_keys_have_no_channel(key):
    assert channel_of_key(key) is None


def test_no_key_is_written_elsewhere():
    names = "|".join(re.escape(channel.key.removesuffix("*")) for channel in CHANNELS if "/" in channel.key)
    literal = re.compile(rf"""["']({PREFIX})?({names})""")
    found = [
        f"{path.relative_to(ROOT)}:{number}"
        for folder in ("cli", "services", "shared")
        for path in (ROOT / folder).rglob("*.py")
        if path.name != "channels.py"
        for number, line in enumerate(path.read_text().splitlines(), start=1)
        if literal.search(line)
    ]
    assert found == []


def test_another_robot_s_channel_is_a_channel_of_its_own():
    other = TF.of_robot("fleet/robot_b")
    assert other.key_expr == "fleet/robot_b/hyrecro/tf"
    assert other != TF
    assert channel_of_key(other.key_expr) == TF
