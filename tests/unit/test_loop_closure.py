"""A run around a square of steel that drifts comes to fit where it returns."""

from itertools import pairwise

import numpy as np
import pytest

from services.mapper.loop_closure import close_loops
from shared.geometry import SE3
from shared.runtime.config import MapperConfig
from tests.support.steel_clouds import steel_cloud

CONFIG = MapperConfig(min_range_m=0.0)
SIDE_M = 4.0
REACH_M = 2.5
DRIFT = SE3.exp([0.012, 0.006, -0.006, 0.0, 0.003, 0.009])


def square():
    """Bars around a square, with posts and braces at uneven places, so that no two places look alike."""
    half = SIDE_M / 2
    bars = [((0.0, y, -0.5), (SIDE_M + 0.2, 0.2, 0.2)) for y in (-half, half)]
    bars += [((x, 0.0, -0.5), (0.2, SIDE_M + 0.2, 0.2)) for x in (-half, half)]
    for k, at_m in enumerate((-1.7, -1.1, -0.1, 0.4, 1.3, 1.8)):
        height_m = 0.6 + 0.3 * k
        bars += [
            ((at_m, -half, height_m / 2), (0.15, 0.15, height_m)),
            ((half, 0.8 * at_m, 0.3), (0.12, 0.2, height_m)),
        ]
        bars += [((0.7 * at_m, half, 0.1), (0.2, 0.1, height_m)), ((-half, at_m, height_m / 3), (0.1, 0.15, height_m))]
    return bars


def run(num=18):
    """Clouds and true poses at even distances along the square, the last ones past the first ones."""
    points = steel_cloud(1, num=60_000, bars=square())
    clouds, poses = [], []
    for k in range(num):
        side, along_m = divmod(1.0 * k, SIDE_M)
        T = SE3.rot("z", side * np.pi / 2) @ SE3.trans(along_m - SIDE_M / 2, -SIDE_M / 2) @ SE3.rot("z", 0.1 * k)
        is_near = np.linalg.norm(points - T.translation, axis=1) < REACH_M
        seen = points[is_near][k % 5 :: 5]
        clouds.append(T.inv().apply(seen))
        poses.append(T)
    return clouds, [poses[0].inv() @ T for T in poses]


def drifting(poses):
    drifted = [poses[0]]
    for a, b in pairwise(poses):
        drifted.append(drifted[-1] @ a.inv() @ b @ DRIFT)
    return drifted


def rms_m(poses, true):
    return np.sqrt(np.mean([np.sum((a.translation - b.translation) ** 2) for a, b in zip(poses, true, strict=True)]))


def test_a_run_around_a_square_closes():
    clouds, true = run()
    drifted = drifting(true)
    closed = close_loops(clouds, drifted, CONFIG)
    assert rms_m(drifted, true) > 0.1
    assert rms_m(closed.T_map_lidar, true) < 0.25 * rms_m(drifted, true)
    assert len(closed.returns) >= 2
    for found in closed.returns:
        assert found.later - found.earlier > 10
        step = found.T_earlier_later.inv() @ true[found.earlier].inv() @ true[found.later]
        assert np.linalg.norm(step.translation) < 0.02
        assert found.score > CONFIG.min_score


def test_a_run_that_does_not_return_stays_as_it_is():
    clouds, true = run(num=10)
    drifted = drifting(true)
    closed = close_loops(clouds, drifted, CONFIG)
    assert closed.returns == []
    assert closed.T_map_lidar == drifted


def test_a_place_that_has_changed_is_no_return():
    clouds, true = run()
    elsewhere = np.random.default_rng(5).uniform(-2.0, 2.0, (4000, 3))
    assert close_loops([*clouds[:-2], elsewhere, elsewhere], true, CONFIG).returns == []


@pytest.mark.parametrize("num", [0, 1])
def test_hardly_any_keyframes_are_no_loop(num):
    assert close_loops([np.zeros((1, 3))] * num, [SE3.identity()] * num, CONFIG).returns == []


def test_clouds_without_points_are_no_return():
    _, true = run()
    assert close_loops([np.empty((0, 3))] * len(true), true, CONFIG).returns == []
