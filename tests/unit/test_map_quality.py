import numpy as np
import pytest

from services.evaluator.map_quality import compare_map
from shared.geometry import SE3
from shared.robot.description import Shape, UrdfModel
from shared.solids import Box

SLAB = UrdfModel(
    name="s",
    root="world",
    links=("world",),
    joints=(),
    shapes=(Shape("world", Box((2.0, 2.0, 0.4)), SE3.trans(10.0, 0.0, -0.2)),),
)
"""Its top is the square of 2 x 2 m about (10, 0, 0)."""
EYE = np.array([[10.0, 0.0, 3.0]])


def grid(height_m=0.0, spacing_m=0.002, width_m=2.0):
    steps = np.arange(spacing_m / 2, width_m, spacing_m)
    x, y = np.meshgrid(9.0 + steps, -1.0 + np.arange(spacing_m / 2, 2.0, spacing_m))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height_m)])


def quality(points, **options):
    return compare_map(points, SLAB, rng=np.random.default_rng(1), **options)


def test_a_plane_that_is_shifted_in_closed_form():
    result = quality(grid(height_m=0.015, spacing_m=0.004), eyes_m=EYE)
    assert result.accuracy.mean_m == pytest.approx(0.015, abs=1e-9)
    assert result.completeness == {0.01: 0.0, 0.02: 1.0, 0.05: 1.0}
    assert result.fscore == {0.01: 0.0, 0.02: 1.0, 0.05: 1.0}
    assert result.chamfer_m == pytest.approx(0.015, abs=2e-4)


def test_half_a_map_is_half_complete():
    result = quality(grid(width_m=1.0, spacing_m=0.004), eyes_m=EYE)
    assert result.completeness[0.01] == pytest.approx(0.505, abs=0.006)
    assert result.fscore[0.01] == pytest.approx(2 * 0.505 / 1.505, abs=0.006)


def test_points_beside_the_steel_cost_precision():
    result = quality(np.concatenate([grid(spacing_m=0.01), grid(height_m=0.3, spacing_m=0.01)]), eyes_m=EYE)
    assert result.completeness[0.02] == 1.0
    assert result.fscore[0.02] == pytest.approx(2 * 0.5 / 1.5)
    assert result.chamfer_m == pytest.approx((0.15 + 0.38 * 0.01) / 2, abs=2e-4)  # 0.38 of the spacing to the nearest


def test_without_eyes_the_outer_surface_in_the_box_of_the_map_counts():
    """Around the top there are 5 cm of each of the four sides."""
    result = quality(grid(spacing_m=0.01))
    top_m2, rim_m2 = 4.0, 8.0 * 0.05
    assert result.completeness[0.02] == pytest.approx((top_m2 + 0.4 * rim_m2) / (top_m2 + rim_m2), abs=0.01)


def test_where_nothing_could_be_seen_there_is_no_completeness():
    result = quality(grid(spacing_m=0.1), eyes_m=EYE, max_range_m=2.9)
    assert (result.completeness, result.fscore, result.chamfer_m) == (None, None, None)
    assert result.accuracy.mean_m == pytest.approx(0.0, abs=1e-9)


def test_the_same_seed_gives_the_same_figures():
    assert quality(grid(spacing_m=0.1)).chamfer_m == quality(grid(spacing_m=0.1)).chamfer_m
