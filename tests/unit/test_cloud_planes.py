import numpy as np
import pytest

from shared.cloud_planes import METHODS, ransac_planes, region_planes
from shared.geometry import SE3

RNG = np.random.default_rng(11)
T_ODD = SE3.from_rpy([0.3, -0.5, 0.7], [3.0, -2.0, 5.0])


def face(width_m, length_m, z_m, num_points, x_m=0.0):
    x, y = RNG.uniform(0, 1, (2, num_points))
    return np.column_stack([x_m + width_m * x, length_m * y, z_m + RNG.normal(0, 0.004, num_points)])


FACES = [face(1.0, 2.0, 0.0, 2000), face(0.8, 2.0, 0.5, 1200), face(0.5, 2.0, 1.2, 700, x_m=0.3)]
CLOUD = T_ODD.apply(np.concatenate(FACES))


@pytest.mark.parametrize("method", METHODS)
def test_planes_come_by_size_with_their_points_and_coefficients(method):
    planes = METHODS[method](CLOUD, 3, 0.04, 1)
    np.testing.assert_allclose([len(plane.rows) for plane in planes], [2000, 1200, 700], rtol=0.02)
    normal = T_ODD.rotation[:, 2]
    for plane, z_m in zip(planes, (0.0, 0.5, 1.2), strict=True):
        sign = np.sign(plane.coefficients[:3] @ normal)
        np.testing.assert_allclose(sign * plane.coefficients[:3], normal, atol=0.01)
        middle = CLOUD[plane.rows].mean(axis=0)
        assert abs(middle @ plane.coefficients[:3] + plane.coefficients[3]) < 0.002
        assert normal @ (middle - T_ODD.translation) == pytest.approx(z_m, abs=0.005)
    assert len(np.unique(np.concatenate([plane.rows for plane in planes]))) == sum(len(p.rows) for p in planes)


@pytest.mark.parametrize("method", METHODS)
def test_no_more_planes_than_asked_and_none_of_too_little(method):
    assert len(METHODS[method](CLOUD, 2, 0.04, 1)) == 2
    assert METHODS[method](np.empty((0, 3)), 5, 0.04, 1) == []
    assert METHODS[method](CLOUD[:2], 5, 0.04, 1) == []


def test_the_same_seed_gives_the_same_planes():
    many = np.concatenate([CLOUD] * 4) + RNG.normal(0, 0.003, (4 * len(CLOUD), 3))
    a, b = (ransac_planes(many, max_planes=3, distance_m=0.04, seed=5) for _ in range(2))
    for plane, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(plane.rows, other.rows)


def test_faces_in_one_plane_are_one_to_ransac_and_two_as_regions():
    apart = np.concatenate([face(1.0, 1.0, 0.0, 1000), face(1.0, 1.0, 0.0, 800, x_m=2.0)])
    assert [len(plane.rows) for plane in ransac_planes(apart, max_planes=5, distance_m=0.04, seed=1)] == [1800]
    sizes = [len(plane.rows) for plane in region_planes(apart, max_planes=5, distance_m=0.04)]
    np.testing.assert_allclose(sizes, [1000, 800], rtol=0.02)


def test_regions_turn_at_edges():
    """The faces of a bar of 0.2 m: none takes what is round the corner but its rim."""
    top, side = face(0.2, 2.0, 0.0, 3000), face(0.2, 2.0, 0.0, 3000)
    bar = np.concatenate([top, (SE3.rot("y", np.pi / 2)).apply(side)])
    first, second, *rest = region_planes(bar, max_planes=9, distance_m=0.02)
    cosine = abs(first.coefficients[:3] @ second.coefficients[:3])
    assert cosine < 0.05
    assert len(first.rows) + len(second.rows) > 5000
    assert sum(len(plane.rows) for plane in rest) < 600
