import numpy as np
import pytest
from hypothesis import given, strategies as st

from services.mapper.planes.eigen import diagonalise
from services.mapper.planes.moments import add_moved, add_point, fit_plane, squares_to, times
from shared.geometry import SE3


def moments_of(points):
    M = np.zeros(10)
    for p in points:
        add_point(M, *p)
    return M


def plane_of(normal, through):
    n = np.asarray(normal) / np.linalg.norm(normal)
    return np.append(n, -n @ through)


@given(st.integers(0, 10_000))
def test_the_eigenvalues_are_those_of_a_library(seed):
    B = np.random.default_rng(seed).normal(size=(3, 3))
    A, V = B @ B.T, np.empty((3, 3))
    D = A.copy()
    diagonalise(D, V)
    np.testing.assert_allclose(np.diag(D), np.linalg.eigvalsh(A), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(V @ np.diag(np.diag(D)) @ V.T, A, atol=1e-10)
    np.testing.assert_allclose(V.T @ V, np.eye(3), atol=1e-12)


def test_equal_eigenvalues_are_no_trouble():
    A, V = 2.0 * np.eye(3), np.empty((3, 3))
    diagonalise(A, V)
    np.testing.assert_array_equal(A, 2.0 * np.eye(3))
    np.testing.assert_array_equal(V, np.eye(3))


def test_squared_distances_to_a_plane_come_from_the_moments():
    points = np.random.default_rng(1).normal(size=(50, 3))
    plane = plane_of([1.0, -2.0, 0.5], [0.3, 0.1, -0.2])
    distances = points @ plane[:3] + plane[3]
    M = moments_of(points)
    assert squares_to(M, *plane) == pytest.approx(np.sum(distances**2))
    out = np.zeros((4, 1))
    times(M, plane[:, np.newaxis].copy(), 0, out)
    np.testing.assert_allclose(out[:, 0], np.sum(distances[:, None] * np.column_stack([points, np.ones(50)]), axis=0))


def test_moved_moments_are_those_of_the_moved_points():
    points = np.random.default_rng(2).normal(size=(20, 3))
    T = SE3.exp([0.4, -1.0, 0.3, 0.5, 0.2, -0.9])
    moved = np.zeros(10)
    add_moved(3.0 * moments_of(points), T.rotation.copy(), *T.translation, moved)
    np.testing.assert_allclose(moved, 3.0 * moments_of(T.apply(points)), atol=1e-9)


def test_the_plane_of_a_rectangle_is_found_with_its_widths():
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 41), np.linspace(-0.1, 0.1, 21))
    flat = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    T = SE3.exp([0.2, 0.1, -0.3, 0.4, -0.8, 0.3])
    plane = np.empty(4)
    across, along = fit_plane(moments_of(T.apply(flat)), plane)
    expected = plane_of(T.rotation[:, 2], T.translation)
    np.testing.assert_allclose(plane * np.sign(plane @ expected), expected, atol=1e-9)
    assert across == pytest.approx(0.0, abs=1e-12)
    assert along == pytest.approx(np.var(y), rel=1e-9)
