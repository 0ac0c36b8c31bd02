import numpy as np
import pytest

from services.mapper.planes.noise import (
    DEFAULT_SIGMA_M,
    NUM_RANGE_BINS,
    range_bin,
    range_residuals,
    robust_sigma,
    sigma_by_range,
)
from services.mapper.planes.order import in_order
from shared.geometry import SE3
from tests.support.box_scans import frame_of_bars, grid_of_rays, room, scan


@pytest.mark.parametrize("sigma_m", [0.002, 0.008, 0.03])
@pytest.mark.parametrize("boxes", [frame_of_bars(), room()], ids=["bars", "room"])
def test_the_noise_is_found_in_one_scan(boxes, sigma_m):
    points = scan(boxes, SE3.identity(), grid_of_rays(64, 512), sigma_m, seed=3)
    found = sigma_by_range(points)
    assert found.shape == (NUM_RANGE_BINS,)
    assert found[range_bin(1.8)] == pytest.approx(sigma_m, rel=0.12)


def test_noise_that_grows_with_range_is_found_by_range():
    points = scan(room(), SE3.identity(), grid_of_rays(64, 512), lambda r: 0.004 * r**2, seed=1)
    found = sigma_by_range(points)
    for range_m in (1.5, 1.9, 2.4):
        assert found[range_bin(range_m)] == pytest.approx(0.004 * range_m**2, rel=0.25)


def test_rays_that_meet_a_plane_predict_one_another_exactly_also_across_a_gap():
    angles = np.array([0.0, 0.01, 0.03, 0.035, 0.06])
    ranges = 2.0 / np.cos(angles + 1.2)  # a grazing wall
    points = np.column_stack([np.cos(angles) * ranges, np.sin(angles) * ranges, np.zeros(5)])
    residuals, used = np.empty(5), np.empty(5)
    assert range_residuals(points, residuals, used) == 3
    np.testing.assert_allclose(residuals[:3], 0.0, atol=1e-12)
    np.testing.assert_allclose(used[:3], ranges[1:4])


def test_a_fifth_of_outliers_hardly_moves_the_estimate():
    rng = np.random.default_rng(0)
    magnitudes = np.abs(np.concatenate([rng.normal(0, 0.01, 4000), rng.normal(0, 3.0, 1000)]))
    assert robust_sigma(magnitudes) == pytest.approx(0.01, rel=0.05)


def test_a_scan_that_tells_nothing_gets_the_default():
    assert (sigma_by_range(np.zeros((0, 3))) == DEFAULT_SIGMA_M).all()
    assert (sigma_by_range(np.zeros((500, 3), np.float32)) == DEFAULT_SIGMA_M).all()


def test_only_a_shuffled_scan_is_put_in_order():
    points = scan(frame_of_bars(), SE3.identity(), grid_of_rays(), 0.008)
    assert in_order(points) is points
    shuffled = np.random.default_rng(0).permutation(points)
    ordered = in_order(shuffled)
    np.testing.assert_array_equal(np.sort(ordered, axis=0), np.sort(points, axis=0))
    gaps = np.linalg.norm(np.diff(ordered, axis=0), axis=1)
    assert np.median(gaps) < 0.06 < np.median(np.linalg.norm(np.diff(shuffled, axis=0), axis=1))
