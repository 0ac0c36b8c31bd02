import numpy as np

from services.mapper.keyframe_map import KeyframeMap, LastScan
from services.mapper.methods.gicp import Gicp
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

CONFIG = MapperConfig(voxel_size_m=0.05, keyframe_novelty=0.05, max_correspondence_m=0.1, max_range_m=3.0)
STAND = SE3.identity()


def wall(x_m=1.0, num=60):
    """A grid of num x num points, 0.04 m apart, on the plane x = x_m."""
    y, z = np.meshgrid(0.04 * np.arange(num), 0.04 * np.arange(num))
    return np.column_stack([np.full(y.size, x_m), y.ravel(), z.ravel()])


def with_new(share):
    """The wall, of which this share of the points was put 0.5 m in front of it."""
    points = wall()
    points[: round(share * len(points)), 0] = 0.5
    return points


def test_the_first_scan_is_the_map():
    mapped = KeyframeMap(wall(), STAND, CONFIG, Gicp)
    assert mapped.points_m[:, 0].tolist() == [1.0] * len(mapped.points_m)
    np.testing.assert_allclose(mapped.registration.distances(np.array([[0.5, 1.0, 1.0]])), [0.5], atol=0.01)


def test_what_is_known_is_not_added_again():
    mapped = KeyframeMap(wall(), STAND, CONFIG, Gicp)
    before = mapped.points_m
    for k in range(20):
        mapped.add(wall(x_m=1.0 + 0.003 * k), STAND)
    np.testing.assert_array_equal(mapped.points_m, before)


def test_a_scan_that_shows_enough_is_added_where_it_was_taken():
    mapped = KeyframeMap(wall(), STAND, CONFIG, Gicp)
    T_map_lidar = SE3.trans(0.2, 0.0, 0.1) @ SE3.rot("z", 0.1)
    mapped.add(T_map_lidar.inv().apply(with_new(0.06)), T_map_lidar)
    assert np.abs(mapped.points_m[:, 0] - 0.5).min() < 1e-9
    assert mapped.registration.distances(np.array([[0.5, 0.5, 0.0]]))[0] < 0.04


def test_what_is_small_is_added_when_it_stays():
    mapped = KeyframeMap(wall(), STAND, CONFIG, Gicp)
    for _ in range(2):
        mapped.add(with_new(0.02), STAND)
    assert mapped.points_m[:, 0].min() == 1.0
    mapped.add(with_new(0.02), STAND)
    assert mapped.points_m[:, 0].min() == 0.5


def test_scans_are_registered_to_what_is_in_reach():
    mapped = KeyframeMap(wall(), STAND, CONFIG, Gicp)
    mapped.add(wall(), SE3.trans(x_m=20.0))
    assert mapped.points_m[:, 0].min() == 1.0
    assert mapped.registration.distances(wall()[:1])[0] > 19.0


def test_the_last_scan_replaces_the_one_before():
    last = LastScan(wall(), STAND, CONFIG, Gicp)
    last.add(wall(x_m=2.0), SE3.trans(x_m=1.0))
    np.testing.assert_allclose(last.points_m[:, 0], 3.0)
    np.testing.assert_allclose(last.registration.distances(np.array([[1.0, 1.0, 1.0]])), [2.0], atol=0.01)
