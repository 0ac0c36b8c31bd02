import numpy as np
import pytest

from services.mapper.filters import ScanFilter, Verdict, outliers
from shared.runtime.config import MapperConfig

CONFIG = MapperConfig(min_range_m=0.5, max_range_m=3.0)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_gate_keeps_what_lies_between(dtype):
    points = np.array([[0.1, 0, 0], [0, 0.5, 0], [0, 0, -3.0], [4.0, 4.0, 4.0]], dtype=dtype)
    filtered = ScanFilter(CONFIG).filtered(points)
    np.testing.assert_array_equal(filtered.points_m, points[1:3])
    assert filtered.points_m.dtype == dtype
    assert filtered.verdicts.tolist() == [Verdict.OUT_OF_RANGE, Verdict.KEPT, Verdict.KEPT, Verdict.OUT_OF_RANGE]


def test_what_is_not_finite_is_dropped_and_counted():
    points = np.ones((5, 3))
    points[0, 1], points[2, 0], points[3] = np.nan, np.inf, (np.inf, -np.inf, 1.0)
    filtered = ScanFilter(CONFIG).filtered(points)
    assert len(filtered.points_m) == 2
    assert filtered.counts == dict.fromkeys(Verdict, 0) | {Verdict.KEPT: 2, Verdict.NOT_FINITE: 3}


def test_the_box_keeps_what_is_inside():
    config = CONFIG.model_copy(update={"crop_m": (-1.0, 1.0, 0.0, 2.0, 0.5, 2.0)})
    inside = np.array([[-1.0, 0.0, 0.5], [0.9, 1.9, 1.5]])
    outside = inside[0] + np.array([[-0.1, 0, 0], [2.1, 0, 0], [0, -0.1, 0], [0, 2.1, 0], [0, 0, -0.1], [0, 0, 1.6]])
    filtered = ScanFilter(config).filtered(np.concatenate([outside, inside]))
    np.testing.assert_array_equal(filtered.points_m, inside)
    assert filtered.counts[Verdict.OUT_OF_BOX] == 6


def test_the_order_stays_and_the_body_goes():
    points = np.random.default_rng(3).uniform(-1.5, 1.5, (200, 3))
    is_body = np.arange(200) % 3 == 0
    filtered = ScanFilter(CONFIG).filtered(points, is_body)
    is_far = np.linalg.norm(points, axis=1) >= 0.5
    np.testing.assert_array_equal(filtered.points_m, points[is_far & ~is_body])
    assert filtered.counts[Verdict.ON_BODY] == (is_far & is_body).sum()


def test_what_stands_alone_is_an_outlier():
    wall = np.stack(np.meshgrid([1.0], 0.05 * np.arange(20), 0.05 * np.arange(20)), axis=-1).reshape(-1, 3)
    alone = np.array([[1.4, 0.5, 0.5]])
    config = CONFIG.model_copy(update={"num_outlier_neighbours": 6, "outlier_deviations": 5.0})
    filtered = ScanFilter(config).filtered(np.concatenate([wall[:50], alone, wall[50:]]))
    np.testing.assert_array_equal(filtered.points_m, wall)
    assert np.flatnonzero(filtered.verdicts).tolist() == [50]
    assert filtered.verdicts[50] == Verdict.OUTLIER


@pytest.mark.parametrize("num_neighbours", [1, 5])
def test_outliers_are_those_beyond_mean_and_deviations(num_neighbours):
    points = np.random.default_rng(4).standard_normal((120, 3))
    distances = np.sort(np.linalg.norm(points[:, None] - points[None], axis=-1), axis=1)[:, 1 : num_neighbours + 1]
    means = distances.mean(axis=1)
    expected = means > means.mean() + 1.5 * means.std()
    assert expected.any()
    np.testing.assert_array_equal(outliers(points, num_neighbours, 1.5), expected)


@pytest.mark.parametrize("num_points", [0, 1, 2])
def test_few_points_pass_as_they_are(num_points):
    config = CONFIG.model_copy(update={"num_outlier_neighbours": 5})
    points = np.full((num_points, 3), 1.0, dtype=np.float32)
    np.testing.assert_array_equal(ScanFilter(config).filtered(points).points_m, points)
