"""Sensors as processes: presets, further sensors with a mount, clouds only while somebody takes them, ground truth."""

import numpy as np
import pytest

from shared.messaging.channels import (
    DEPTH_CAMERA_INFO,
    DEPTH_IMAGE,
    DEPTH_IMU,
    DEPTH_POINTS,
    HEALTH,
    LIDAR_IMU,
    LIDAR_POINTS,
)
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import CameraInfo, DepthImage, Health, Imu, LidarScan, PointCloud
from tests.e2e.conftest import ALL_SERVICES, wait_for_services
from tests.support.processes import hyrecro_command, started, wait_until

pytestmark = pytest.mark.e2e

SETTINGS = [
    "sensors.lidar.preset=datasheet",
    "sensors.lidar.truth=true",
    "sensors.depth.preset=datasheet",
    "sensors.others={depth_rear: {kind: depth, rate_hz: 6, frame: rear_optical, "
    "mount: {parent: hip, xyz_m: [-0.05, 0, 0.02], rpy_deg: [0, 15, 180]}}}",
]


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    options = [part for setting in SETTINGS for part in ("--set", setting)]
    with started(hyrecro_command("up", *options), tmp_path_factory.mktemp("up")) as running:
        wait_for_services(running, ALL_SERVICES | {"depth_rear"})
        yield running


def received(pipeline, channel, message_type, count):
    """So many messages of a channel, one after the other as they come."""
    inbox = Inbox(max_bytes=2**28)
    with pipeline.bus() as bus:
        bus.subscribe(channel, inbox)
        parcels = [inbox.take(20.0) for _ in range(count)]
    assert None not in parcels, f"nothing on {channel.key}"
    return [decode(message_type, parcel.payload) for parcel in parcels]


def num_sent(pipeline, channel):
    with pipeline.bus() as bus:
        health = wait_until(lambda: bus.ask(HEALTH.of("depth"), Health), "a heartbeat of the camera")
    return sum(count.num_sent for count in health.channels if count.key == channel.key_expr)


def test_scans_turn_at_their_rate_and_tell_the_truth(pipeline):
    scans = received(pipeline, LIDAR_POINTS, LidarScan, 3)
    assert all(scan.stamp_ns % 100_000_000 == 0 for scan in scans)
    for scan in scans:
        assert scan.frame == "lidar"
        assert 90_000_000 < scan.t_ns.max() < 100_000_000
        assert len(scan.points_m) > 10_000
        assert len(np.unique(scan.member)) > 5
        assert np.median(np.abs(np.linalg.norm(scan.points_m - [0, 0, 0.036], axis=1) - scan.true_range_m)) < 0.03


@pytest.mark.parametrize(("channel", "period_ns"), [(LIDAR_IMU, 10_000_000), (DEPTH_IMU, 5_000_000)])
def test_imus_measure_gravity_on_their_own_clock(pipeline, channel, period_ns):
    readings = received(pipeline, channel, Imu, 20)
    assert all(reading.stamp_ns % period_ns == 0 for reading in readings)
    forces = [np.linalg.norm(reading.linear_acceleration_mps2) for reading in readings]
    assert np.mean(forces) == pytest.approx(9.81, abs=1.0)


def test_images_come_with_their_intrinsics(pipeline):
    (image,) = received(pipeline, DEPTH_IMAGE, DepthImage, 1)
    (info,) = received(pipeline, DEPTH_CAMERA_INFO, CameraInfo, 1)
    assert (image.height, image.width) == (info.height, info.width) == (480, 848)
    assert image.frame == info.frame == "depth_optical"
    assert 0.05 < np.mean(image.depth_mm > 0) < 1
    assert image.depth_mm[image.depth_mm > 0].min() >= 300
    assert image.depth_mm.max() <= 3000


def test_clouds_are_made_only_while_somebody_takes_them(pipeline):
    assert num_sent(pipeline, DEPTH_POINTS) == 0
    (cloud, *_) = received(pipeline, DEPTH_POINTS, PointCloud, 2)
    assert cloud.frame == "depth_optical"
    assert (cloud.points_m[:, 2] > 0.29).all()

    def has_stopped():
        before = num_sent(pipeline, DEPTH_POINTS), num_sent(pipeline, DEPTH_IMAGE)
        wait_until(lambda: num_sent(pipeline, DEPTH_IMAGE) > before[1], "further images")
        return num_sent(pipeline, DEPTH_POINTS) == before[0] > 0

    wait_until(has_stopped, "no clouds when nobody listens")


def test_a_further_camera_has_keys_of_its_own_and_looks_elsewhere(pipeline):
    (rear,) = received(pipeline, DEPTH_IMAGE.of_sensor("depth_rear"), DepthImage, 1)
    (front,) = received(pipeline, DEPTH_IMAGE, DepthImage, 1)
    assert rear.frame == "rear_optical"
    assert not np.array_equal(rear.depth_mm, front.depth_mm)
