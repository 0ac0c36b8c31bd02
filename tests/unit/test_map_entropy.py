import math

import numpy as np
import pytest

from services.evaluator.map_entropy import mean_map_entropy

RADIUS_M = 0.1


def plane(sigma_m, num_points=16_000):
    """A plane of 2 x 2 m."""
    rng = np.random.default_rng(4)
    return np.column_stack([rng.uniform(0, 2, (num_points, 2)), rng.normal(0, sigma_m, num_points)])


def entropy(points, **options):
    return mean_map_entropy(
        points, **{"radius_m": RADIUS_M, "max_queries": 500} | options, rng=np.random.default_rng(1)
    )


def of_plane(sigma_m):
    """Points even over a disk of radius r have variances r^2 / 4; across it they have sigma^2."""
    return 0.5 * math.log((2 * math.pi * math.e) ** 3 * (RADIUS_M**2 / 4) ** 2 * sigma_m**2)


@pytest.mark.parametrize("sigma_m", [0.002, 0.005])
def test_a_plane_in_closed_form(sigma_m):
    """But for its rim, where half disks are, and for the sample's covariance being over n."""
    assert entropy(plane(sigma_m)) == pytest.approx(of_plane(sigma_m), abs=0.1)


def test_far_from_the_origin_nothing_is_lost_and_a_part_of_the_points_will_do():
    points = plane(0.005)
    assert entropy(points + np.array([1e5, -1e5, 1e4])) == pytest.approx(entropy(points), abs=1e-4)
    assert entropy(points, max_queries=2000) == pytest.approx(entropy(points), abs=0.02)


def test_a_blurred_map_has_more_entropy_by_the_logarithm():
    assert entropy(plane(0.008)) - entropy(plane(0.004)) == pytest.approx(math.log(2), abs=0.02)


def test_a_plane_without_noise_is_finite():
    assert entropy(plane(0.0)) == pytest.approx(of_plane(1e-4), abs=0.1)


def test_points_without_neighbours_do_not_count():
    far = np.arange(30.0)[:, None] * [1.0, 0.0, 0.0]
    assert entropy(far) is None
    assert entropy(np.empty((0, 3))) is None
    few = plane(0.005, 1000)
    assert entropy(np.concatenate([few, far + 50]), max_queries=2000) == pytest.approx(entropy(few, max_queries=2000))
