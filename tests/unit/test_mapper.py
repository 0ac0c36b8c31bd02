import itertools

import numpy as np
import pytest

from services.mapper.mapper import Mapper
from shared.geometry import SE3
from shared.messaging.messages import Event, LidarScan, MapStatus, Odometry, PointCloud
from shared.runtime.config import MapperConfig
from tests.support.box_scans import Box, grid_of_rays, scan as box_scan

PERIOD_NS = 100_000_000


RAYS = grid_of_rays(64, 512)
ROOM = [
    *(Box(SE3.trans(*(sign * 2.1 * np.eye(3)[0])), (0.1, 2.0, 2.0)) for sign in (-1, 1)),
    *(Box(SE3.trans(*(sign * 1.6 * np.eye(3)[1])), (2.5, 0.1, 2.0)) for sign in (-1, 1)),
    *(Box(SE3.trans(*(sign * 1.3 * np.eye(3)[2])), (2.5, 2.0, 0.1)) for sign in (-1, 1)),
    Box(SE3.trans(0.9, 0.7), (0.15, 0.15, 1.2)),
]
"""4 x 3 x 2.4 m with a pillar; the world's origin is in its middle."""


def scan(k, T_world_lidar=None, points=None, seq=None):
    if points is None:
        points = box_scan(ROOM, T_world_lidar or SE3.identity(), RAYS, 0.003, seed=k)
    num = len(points)
    return LidarScan(
        stamp_ns=k * PERIOD_NS,
        seq=k if seq is None else seq,
        frame="lidar",
        points_m=points,
        intensity=np.zeros(num),
        t_ns=np.zeros(num),
        ring=np.zeros(num),
    )


def pose(k):
    """A curve at 0.2 m/s that turns by 17 degrees a second."""
    return SE3.exp(k * np.array([0.02, 0.005, 0.0, 0.0, 0.0, 0.03]))


@pytest.fixture(params=["plane", "gicp"])
def mapper(request):
    ticks = itertools.count(0, 2_000_000)
    return Mapper(MapperConfig(method=request.param), clock_ns=lambda: next(ticks))


def only(kind, messages):
    (message,) = (message for message in messages if type(message) is kind)
    return message


def feed(mapper, scans):
    return [mapper.add_scan(each, received_ns=0) for each in scans]


def test_it_follows_a_curve(mapper):
    answers = feed(mapper, [scan(k, pose(k)) for k in range(12)])
    for k, messages in enumerate(answers):
        odometry, status = only(Odometry, messages), only(MapStatus, messages)
        error = pose(k).inv() @ SE3.from_xyz_quat_xyzw(odometry.T_frame_child)
        assert np.linalg.norm(error.translation) < 0.005
        assert error.angle_rad < 0.005
        assert (odometry.frame, odometry.child_frame, odometry.seq) == ("map", "lidar_estimated", k)
        assert (status.is_tracking, status.scan_seq, status.prior) == (True, k, "constant_velocity")
    assert only(Odometry, answers[-1]).covariance is not None


def test_the_map_comes_at_its_rate_and_holds_the_room(mapper):
    answers = feed(mapper, [scan(k, pose(k)) for k in range(12)])
    clouds = [message for messages in answers for message in messages if isinstance(message, PointCloud)]
    assert [cloud.stamp_ns // PERIOD_NS for cloud in clouds] == [0, 10]
    assert [cloud.seq for cloud in clouds] == [0, 1]
    assert clouds[-1].frame == "map"
    np.testing.assert_allclose(np.abs(clouds[-1].points_m).max(axis=0), [2.0, 1.5, 1.2], atol=0.03)


def test_nothing_to_see_at_first_makes_no_map(mapper):
    (messages,) = feed(mapper, [scan(0, points=np.empty((0, 3)))])
    assert [type(message) for message in messages] == [MapStatus, Event]
    assert not messages[0].is_tracking
    assert "lost: scan 0 has too few points to begin a map" in messages[1].text
    (messages,) = feed(mapper, [scan(1)])
    assert only(MapStatus, messages).is_tracking


@pytest.mark.parametrize("num_points", [0, 1, 19])
def test_a_blind_scan_keeps_the_prediction_and_says_so(mapper, num_points):
    feed(mapper, [scan(k, pose(k)) for k in range(4)])
    before = only(MapStatus, feed(mapper, [scan(4, pose(4))])[0]).num_map_points
    (messages,) = feed(mapper, [scan(5, points=np.ones((num_points, 3)))])
    status = only(MapStatus, messages)
    assert (status.is_tracking, status.fitness, status.num_map_points) == (False, None, before)
    predicted = SE3.from_xyz_quat_xyzw(only(Odometry, messages).T_frame_child)
    assert np.linalg.norm((pose(5).inv() @ predicted).translation) < 0.01


def test_it_finds_back_after_blind_scans(mapper):
    feed(mapper, [scan(k, pose(k)) for k in range(5)])
    feed(mapper, [scan(k, points=np.empty((0, 3))) for k in range(5, 8)])
    (messages,) = feed(mapper, [scan(8, pose(8))])
    assert only(MapStatus, messages).is_tracking
    found = SE3.from_xyz_quat_xyzw(only(Odometry, messages).T_frame_child)
    assert np.linalg.norm((pose(8).inv() @ found).translation) < 0.005


def test_another_place_is_not_taken_for_this_one(mapper):
    feed(mapper, [scan(k) for k in range(3)])
    elsewhere = np.random.default_rng(0).uniform(-3, 3, (5000, 3))
    status = only(MapStatus, feed(mapper, [scan(3, points=elsewhere)])[0])
    assert not status.is_tracking


def test_missed_scans_are_counted(mapper):
    answers = feed(mapper, [scan(0, seq=0), scan(1, seq=1), scan(2, seq=5)])
    assert [only(MapStatus, messages).num_scans_missed for messages in answers] == [0, 0, 3]
    assert [only(MapStatus, messages).seq for messages in answers] == [0, 1, 2]


def test_times_are_those_of_the_clock_that_was_given(mapper):
    status = only(MapStatus, feed(mapper, [scan(0)])[0])
    assert status.registration_ms > 0
    assert status.lag_ms > status.registration_ms


def test_a_restarted_run_goes_on_where_the_map_began(mapper):
    feed(mapper, [scan(k, pose(k)) for k in range(12)])
    (messages,) = feed(mapper, [scan(0, seq=0)])
    assert only(MapStatus, messages).is_tracking
    found = SE3.from_xyz_quat_xyzw(only(Odometry, messages).T_frame_child)
    assert np.linalg.norm(found.translation) < 0.005


def test_a_restarted_run_starts_from_rest_at_the_maps_origin():
    mapper = Mapper(MapperConfig(max_jump_m=0.05), clock_ns=lambda: 0)
    (*_, before) = feed(mapper, [scan(k, pose(min(k, 10))) for k in range(13)])
    (messages,) = feed(mapper, [scan(0, seq=0)])
    assert only(MapStatus, messages).is_tracking
    num_before = only(MapStatus, before).num_map_points
    assert num_before <= only(MapStatus, messages).num_map_points < 1.01 * num_before


def test_a_restarted_run_elsewhere_gets_a_new_map(mapper):
    feed(mapper, [scan(k, pose(k)) for k in range(5)])
    elsewhere = box_scan(ROOM, SE3.identity(), RAYS, 0.003) * (0.8, 3.0, 0.5)
    (messages,) = feed(mapper, [scan(0, points=elsewhere)])
    odometry = only(Odometry, messages)
    assert only(MapStatus, messages).is_tracking
    assert np.abs(mapper.map_cloud().points_m[:, 1]).max() > 4.0
    assert np.abs(mapper.map_cloud().points_m[:, 0]).max() < 1.7
    np.testing.assert_array_equal(odometry.T_frame_child, SE3.identity().xyz_quat_xyzw)


def test_a_lost_scan_does_not_enter_the_map(mapper):
    feed(mapper, [scan(k) for k in range(3)])
    before = len(mapper.map_cloud().points_m)
    feed(mapper, [scan(3, points=np.random.default_rng(0).uniform(-3, 3, (5000, 3)))])
    assert len(mapper.map_cloud().points_m) == before


SHAFT = [
    *(Box(SE3.trans(sign * 2.1), (0.1, 1.0, 0.6)) for sign in (-1, 1)),
    *(Box(SE3.trans(0.0, sign * 1.6), (1.5, 0.1, 0.4)) for sign in (-1, 1)),
    *(Box(SE3.trans(sign * 1.75, 0.0, -0.5), (0.25, 0.3, 0.02)) for sign in (-1, 1)),
]
"""Four upright plates, whose faces leave z open, and two ledges so small that hardly a ray in a hundred meets them."""


def test_where_faces_leave_a_direction_open_the_cloud_holds_it(mapper):
    def up_and_down(k):
        return SE3.trans(0.01 * k, 0.0, 0.05 * np.sin(0.9 * k))

    answers = feed(mapper, [scan(k, points=box_scan(SHAFT, up_and_down(k), RAYS, 0.005, seed=k)) for k in range(12)])
    for k, messages in enumerate(answers):
        error = up_and_down(k).inv() @ SE3.from_xyz_quat_xyzw(only(Odometry, messages).T_frame_child)
        assert only(MapStatus, messages).is_tracking
        assert np.linalg.norm(error.translation) < 0.01
