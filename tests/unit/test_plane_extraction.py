import numpy as np
import pytest

from services.mapper.planes.extraction import extract_planes
from services.mapper.planes.noise import NUM_RANGE_BINS
from services.mapper.planes.runs import MAX_RUN_M, MAX_RUN_POINTS, cut_runs
from shared.geometry import SE3
from tests.support.box_scans import frame_of_bars, grid_of_rays, room, scan


def runs_of(points, sigma_m=0.005):
    return cut_runs(points, np.full(NUM_RANGE_BINS, sigma_m))


def test_runs_hold_all_points_once():
    points = scan(frame_of_bars(), SE3.identity(), grid_of_rays(), 0.005)
    runs = runs_of(points)
    assert runs.num_points.sum() == len(points)
    assert 1 < runs.num_points.max() <= MAX_RUN_POINTS
    h = np.column_stack([points.astype(np.float64), np.ones(len(points))])
    np.testing.assert_allclose(runs.moments.sum(axis=0), (h.T @ h)[np.triu_indices(4)], rtol=1e-9, atol=1e-5)
    starts = np.cumsum(runs.num_points) - runs.num_points
    ends = starts + runs.num_points - 1
    assert np.linalg.norm(points[ends] - points[starts], axis=1).max() <= MAX_RUN_M * 1.0001
    np.testing.assert_allclose(runs.centroids_m[0], points[: runs.num_points[0]].mean(axis=0), atol=1e-6)


def test_a_run_knows_its_direction_where_it_is_long_enough():
    points = np.array([[1.0, y, 0.5] for y in (0.0, 0.01, 0.02, 0.03)] + [[9.0, 0.0, 0.0]])
    runs = runs_of(points, 0.003)
    np.testing.assert_allclose(runs.directions, [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-12)
    assert runs.slopes[0] == pytest.approx(0.003 / 0.03 / np.sqrt(4 / 3))


def test_no_points_give_no_runs():
    assert len(runs_of(np.empty((0, 3))).num_points) == 0


@pytest.mark.parametrize("T_world_lidar", [SE3.identity(), SE3.exp([0.1, 0.2, -0.1, 0.7, -0.4, 1.9])])
def test_the_walls_of_a_room_are_found_and_face_the_lidar(T_world_lidar):
    runs = runs_of(scan(room(), T_world_lidar, grid_of_rays(), 0.003))
    planes, labels = extract_planes(runs, np.arange(len(runs.num_points)), T_world_lidar.matrix[:3].copy(), 0.1, 100)
    walls = {(1, 0, 0): 1.7, (-1, 0, 0): 2.3, (0, 1, 0): 1.4, (0, -1, 0): 1.6, (0, 0, 1): 0.9, (0, 0, -1): 1.1}
    num_points = np.bincount(labels[labels >= 0], runs.num_points[labels >= 0])
    large = planes[num_points > 400]
    for plane in large:
        wall = np.round(plane[:3])
        assert plane[:3] @ wall > np.cos(np.radians(2.0))
        # A tilt of a small piece shows in its offset at the origin, which may be 1 m away.
        assert plane[3] == pytest.approx(walls[tuple(wall.astype(int))], abs=0.03)
    assert {tuple(np.round(plane[:3]).astype(int)) for plane in large} == set(walls)
    assert runs.num_points[labels >= 0].sum() > 0.8 * runs.num_points.sum()


def test_only_chosen_runs_are_looked_at_and_so_many_planes_taken():
    runs = runs_of(scan(room(), SE3.identity(), grid_of_rays(), 0.003))
    here = np.eye(3, 4)
    planes, labels = extract_planes(runs, np.arange(0), here, 0.1, 100)
    assert planes.shape == (0, 4)
    assert len(labels) == 0
    planes, labels = extract_planes(runs, np.arange(len(runs.num_points)), here, 0.1, 3)
    assert len(planes) == 3
    assert set(labels) == {-1, 0, 1, 2}


def test_points_in_a_ball_have_no_plane():
    ball = np.random.default_rng(0).normal(size=(3000, 3)) * 0.2 + [2.05, 0.05, 0.05]
    runs = runs_of(ball)
    planes, _ = extract_planes(runs, np.arange(len(runs.num_points)), np.eye(3, 4), 0.1, 100)
    assert len(planes) == 0
