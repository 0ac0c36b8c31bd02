import numpy as np
import pytest

from services.evaluator.surface import TrueSurface
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.robot.description import Shape
from shared.solids import Box, Cylinder, Mesh

EVERYWHERE = (np.full(3, -1e4), np.full(3, 1e4))


def rng():
    return np.random.default_rng(8)


def cube(x_m=0.0, size_m=1.0):
    return Shape("s", Box((size_m, size_m, size_m)), SE3.trans(x_m))


def sampled(*shapes, low=EVERYWHERE[0], high=EVERYWHERE[1]):
    surface = TrueSurface(shapes)
    return surface, surface.near(low, high, 20_000, rng())


def test_samples_are_even_over_the_faces_of_a_box():
    _, samples = sampled(Shape("s", Box((1.0, 2.0, 3.0)), SE3.trans(1e3)))
    np.testing.assert_allclose(np.linalg.norm(samples.normals, axis=1), 1.0)
    local = samples.points_m - [1e3, 0, 0]
    np.testing.assert_allclose(np.einsum("ij,ij->i", local, samples.normals) * 2, np.abs(samples.normals) @ [1, 2, 3])
    shares = (np.abs(samples.normals) > 0.5).mean(axis=0)
    np.testing.assert_allclose(shares, np.array([6, 3, 2]) / 11, atol=0.015)


def test_a_box_cuts_the_samples():
    _, samples = sampled(cube(), low=np.array([-1.0, -1.0, 0.4]), high=np.ones(3))
    assert samples.points_m[:, 2].min() >= 0.4
    assert len(samples.points_m) == pytest.approx(20_000 * (1 + 4 * 0.1) / 5, rel=0.05)  # of 5 faces that reach in


def test_steel_inside_other_steel_and_flush_on_it_is_left_out():
    _, inside = sampled(cube(), cube(size_m=0.5))
    assert np.abs(inside.points_m).max(axis=1).min() == pytest.approx(0.5)
    _, flush = sampled(cube(), cube(x_m=1.0))
    assert not (np.abs(flush.points_m[:, 0] - 0.5) < 1e-6).any()
    whole = mesh_of(Box((0.5, 0.5, 0.5)))
    _, meshed = sampled(cube(), Shape("s", whole, SE3.identity()))
    assert np.abs(meshed.points_m).max(axis=1).min() == pytest.approx(0.5)
    _, open_one = sampled(cube(), Shape("s", Mesh(whole.vertices_m * 3, whole.triangles[:-1]), SE3.identity()))
    assert np.abs(open_one.points_m).max(axis=1).min() == pytest.approx(0.5)  # what is in an open mesh is not hidden
    _, crossing = sampled(cube(), Shape("s", Cylinder(0.2, 3.0), SE3.identity()))
    is_cylinder = np.abs(crossing.normals).max(axis=1) < 0.999
    assert np.abs(crossing.points_m[is_cylinder, 2]).min() > 0.5 - 1e-3


def test_what_is_seen_faces_the_eye_in_range_with_nothing_between():
    surface, samples = sampled(cube(), cube(x_m=-3.0))
    is_seen = surface.is_seen(samples, np.array([[5.0, 0.0, 0.0]]), max_range_m=20.0)
    expected = (samples.normals[:, 0] > 0.5) & (samples.points_m[:, 0] > 0)  # the other cube is in its shadow
    np.testing.assert_array_equal(is_seen, expected)
    assert surface.is_seen(samples, np.array([[5.0, 0.0, 0.0], [-1.5, 0.0, 0.0]]), 20.0).mean() == pytest.approx(
        3 / 12, abs=0.01
    )
    near = surface.is_seen(samples, np.array([[5.0, 0.0, 0.0]]), max_range_m=4.53)
    is_in_range = np.linalg.norm(samples.points_m - [5, 0, 0], axis=1) <= 4.53
    assert 0 < near.sum() < is_seen.sum()
    np.testing.assert_array_equal(near, expected & is_in_range)


def test_a_structure_without_shapes_is_refused():
    with pytest.raises(ValueError, match="no shapes"):
        TrueSurface([])
