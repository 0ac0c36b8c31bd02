import numpy as np
import pytest
from hypothesis import given, strategies as st

from shared.climbing.convex import Zonotopes, depths, depths_in_faces, stacked, zonotope
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.solids import Box, Cylinder, Sphere

CUBE = Box((2.0, 2.0, 2.0))


def placed(solid, T=None) -> Zonotopes:
    return stacked([zonotope(solid).moved((T or SE3.identity()).matrix)])


def depth_of(a, T_a, b=CUBE, T_b=None):
    forth, back = depths(placed(a, T_a), placed(b, T_b)), depths(placed(b, T_b), placed(a, T_a))
    assert forth == pytest.approx(back, abs=1e-12)
    return forth[0]


@pytest.mark.parametrize(
    ("T", "depth_m"),
    [
        (SE3.trans(1.9), 0.1),
        (SE3.trans(1.9, 1.5, 1.7), 0.1),
        (SE3.trans(2.0), 0.0),
        (SE3.trans(2.5, 2.25), -0.5),
        (SE3.identity(), 2.0),
        (SE3.trans(2.3) @ SE3.rot("z", np.pi / 4), np.sqrt(2) - 1.3),  # an edge in a face
        (SE3.trans(2.5) @ SE3.rot("z", np.pi / 4), np.sqrt(2) - 1.5),
    ],
)
def test_box_in_box_by_hand(T, depth_m):
    assert depth_of(CUBE, T) == pytest.approx(depth_m, abs=1e-12)


def test_crossed_edges_are_seen_apart_though_no_face_separates_them():
    T = SE3.rot("z", np.pi / 4)
    over = SE3.from_rpy((0, 0, 0), (0, 0, 2 * np.sqrt(2) + 0.01)) @ SE3.rot("y", np.pi / 4)
    assert depth_of(CUBE, over, CUBE, SE3.rot("x", np.pi / 4)) == pytest.approx(-0.01, abs=1e-12)
    assert depth_of(CUBE, T @ over, CUBE, T @ SE3.rot("x", np.pi / 4)) == pytest.approx(-0.01, abs=1e-12)


@pytest.mark.parametrize(
    ("T", "depth_m"),
    [
        (SE3.trans(z_m=1.45), 0.05),  # on its end
        (SE3.trans(1.25), 0.05),  # upright against a side: the prism touches where the circle does
        (SE3.trans(z_m=1.25) @ SE3.rot("x", np.pi / 2), 0.05),  # lying on top
    ],
)
def test_cylinder_in_box_by_hand(T, depth_m):
    assert depth_of(Cylinder(0.3, 1.0), T) == pytest.approx(depth_m, abs=1e-12)


def test_a_turned_cylinder_is_no_more_than_its_prism_too_big():
    for turn in np.linspace(0, 0.2, 7):
        depth_m = depth_of(Cylinder(0.3, 1.0), SE3.trans(1.25) @ SE3.rot("z", turn))
        assert 0.05 - 1e-12 <= depth_m < 0.05 + 0.3 * 0.005


def test_a_sphere_is_the_cube_round_it():
    assert depth_of(Sphere(0.5), SE3.trans(1.4)) == pytest.approx(0.1)


def in_mesh(a, T):
    mesh = mesh_of(CUBE)
    corners = mesh.vertices_m[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.linalg.norm(across, axis=1, keepdims=True)
    return depths_in_faces(stacked([zonotope(a).moved(T.matrix)] * len(corners)), corners, normals).max()


@pytest.mark.parametrize(
    ("T", "depth_m"),
    [(SE3.trans(z_m=1.05), 0.05), (SE3.trans(0.3, 0.2, 1.1), 0.0), (SE3.trans(z_m=1.3), -0.2), (SE3.trans(1.02), 0.08)],
)
def test_a_box_in_the_faces_of_a_mesh_by_hand(T, depth_m):
    assert in_mesh(Box((0.2, 0.2, 0.2)), T) == pytest.approx(depth_m, abs=1e-12)


def test_a_box_is_pushed_out_of_a_face_never_through_it():
    """60 of its 100 mm are inside: the way back out is 60 mm, though the way on in would be 40 mm."""
    assert in_mesh(Box((0.1, 0.1, 0.1)), SE3.trans(z_m=0.99)) == pytest.approx(0.06, abs=1e-12)


def test_the_back_of_a_face_is_not_met():
    assert in_mesh(Box((0.1, 0.1, 0.1)), SE3.identity()) < 0


angles = st.floats(-np.pi, np.pi)
places = st.tuples(*3 * [st.floats(-0.5, 0.5)])


@given(places, st.tuples(angles, angles, angles), st.tuples(*3 * [st.floats(0.05, 0.4)]))
def test_no_point_proves_a_depth_too_small_or_a_distance_too_large(xyz, rpy, size):
    half = np.array([0.15, 0.1, 0.05])
    a, b = placed(Box(size), SE3.from_rpy(rpy, xyz)), placed(Box(tuple(2 * half)))
    signs = np.array(np.meshgrid(*3 * [np.linspace(-1, 1, 7)])).reshape(3, -1).T
    points = a.centres[0] + signs @ a.generators[0]
    inside_m = (half - np.abs(points)).min(axis=1).max()
    distance_m = np.linalg.norm(np.maximum(np.abs(points) - half, 0), axis=1).min()
    depth_m = depths(a, b)[0]
    assert depth_m >= (inside_m if inside_m > 0 else -distance_m) - 1e-12
