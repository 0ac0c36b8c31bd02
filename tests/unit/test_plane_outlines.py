import numpy as np
import pytest

from services.mapper.planes.moments import add_point
from services.mapper.planes.outlines import convex_outline, surfaces
from services.mapper.planes.patches import Patches
from shared.geometry import SE3


def rectangle(T, width_m, height_m):
    """Moments about the centre, plane and centre of an even grid of points on a rectangle in the x-y plane of T."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 60) * width_m, np.linspace(-0.5, 0.5, 60) * height_m)
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]) @ T.rotation.T
    M = np.zeros(10)
    for p in points:
        add_point(M, *p)
    n = T.rotation[:, 2]
    return 2.5e4 * M, np.append(n, -n @ T.translation), T.translation


def patches_of(rectangles):
    moments, planes, centres = (np.array(values) for values in zip(*rectangles, strict=True))
    n = len(rectangles)
    return Patches(np.arange(n), planes, np.full(n, 3600), centres, moments, centres)


def test_the_outline_of_a_rectangle_is_the_rectangle():
    T = SE3.exp([3.0, -1.0, 2.0, 0.4, -0.9, 0.3])
    (surface,) = surfaces(patches_of([rectangle(T, 1.0, 0.2)]))
    corners = T.inv().apply(surface.outline_m)
    assert corners.shape == (4, 3)
    np.testing.assert_allclose(np.abs(corners), [[0.5, 0.1, 0.0]] * 4, atol=0.01)
    x, y = corners[:, 0], corners[:, 1]
    assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2 == pytest.approx(0.2, rel=0.05)
    assert (surface.id, surface.num_points) == (0, 3600)


def test_patches_of_one_face_are_one_surface_and_others_are_not():
    far, behind = SE3.trans(3.0), SE3.trans(0.9) @ SE3.rot("x", np.pi)
    above, tilted = SE3.trans(0.9, 0.0, 0.2), SE3.trans(0.5, 0.15) @ SE3.rot("x", 0.5)
    shapes = [SE3.identity(), far, behind, above, tilted, SE3.trans(0.9)]
    found = surfaces(patches_of([rectangle(T, 0.8, 0.2) for T in shapes]))
    assert [surface.id for surface in found] == [0, 1, 2, 3, 4]
    assert found[0].patch_ids.tolist() == [0, 5]
    assert np.ptp(found[0].outline_m[:, 0]) == pytest.approx(1.7, abs=0.03)
    assert found[0].num_points == 7200


def test_parallel_bars_in_one_plane_do_not_touch():
    found = surfaces(patches_of([rectangle(SE3.trans(0.0, y), 1.4, 0.2) for y in (0.0, 0.6)]))
    assert len(found) == 2


def test_patches_without_points_are_no_surface():
    patches = patches_of([rectangle(SE3.identity(), 1.0, 1.0)])
    patches.num_points[0] = 0
    assert surfaces(patches) == []


def test_inner_points_are_not_on_the_hull():
    points = np.array([[0, 0, 0], [2, 0, 0.1], [2, 2, 0], [0, 2, 0], [1, 1, 0], [1, 0, 0], [0, 0, 0.5]], float)
    outline = convex_outline(points, np.array([0.0, 0.0, 1.0]), np.zeros(3))
    assert {tuple(p) for p in np.round(outline, 6)} == {(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)}
