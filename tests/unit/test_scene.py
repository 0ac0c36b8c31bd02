import itertools

import numpy as np
import pytest

from services.sensors.scene import scene_of
from shared.geometry import SE3
from shared.meshes import area_m2, faces_of, mesh_of, polygons_of, volume_m3
from shared.robot.description import Shape
from shared.solids import Box, Cylinder, Mesh, Sphere

NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])
SOLIDS = [
    Box((1, 2, 3)),
    Cylinder(0.5, 2.0),
    Sphere(0.7),
    Mesh(mesh_of(Box((1, 2, 3))).vertices_m, mesh_of(Box((1, 2, 3))).triangles),
]


def corners_of(polygons):
    starts = np.concatenate([[0], np.cumsum(polygons.sizes)])
    return [polygons.vertices_m[a:b] for a, b in itertools.pairwise(starts)]


def area_vector(corners):
    """Normal times area of a plane polygon."""
    return sum(np.cross(corners[i] - corners[0], corners[i + 1] - corners[0]) for i in range(1, len(corners) - 1)) / 2


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda solid: type(solid).__name__)
def test_polygons_are_the_surface_of_the_mesh(solid):
    polygons = polygons_of(solid)
    areas = [area_vector(corners) for corners in corners_of(polygons)]
    assert sum(np.linalg.norm(area) for area in areas) == pytest.approx(area_m2(mesh_of(solid)))
    volume = sum(corners[0] @ area for corners, area in zip(corners_of(polygons), areas, strict=True)) / 3
    assert volume == pytest.approx(volume_m3(mesh_of(solid)))
    assert polygons.is_convex == (not isinstance(solid, Mesh))
    assert len(polygons.faces) == len(polygons.sizes)


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda solid: type(solid).__name__)
def test_polygons_are_plane_and_convex(solid):
    for corners in corners_of(polygons_of(solid)):
        normal = area_vector(corners) / np.linalg.norm(area_vector(corners))
        np.testing.assert_allclose((corners - corners[0]) @ normal, 0, atol=1e-12)
        edges = np.roll(corners, -1, axis=0) - corners
        assert (np.cross(edges, np.roll(edges, -1, axis=0)) @ normal > 0).all()


def test_faces_of_a_box_are_in_the_order_of_its_axes():
    polygons = polygons_of(Box((1, 2, 3)))
    normals = [area_vector(corners) for corners in corners_of(polygons)]
    normals = np.array([normal / np.linalg.norm(normal) for normal in normals])
    np.testing.assert_allclose(normals, NORMALS[polygons.faces], atol=1e-12)


def test_faces_of_a_cylinder_are_side_bottom_and_top():
    polygons = polygons_of(Cylinder(0.5, 2.0))
    along_z = np.array([area_vector(corners)[2] for corners in corners_of(polygons)])
    np.testing.assert_allclose(along_z[polygons.faces == 0], 0, atol=1e-12)
    assert (along_z[polygons.faces == 1] < 0).all()
    assert (along_z[polygons.faces == 2] > 0).all()
    assert set(faces_of(Sphere(1.0))) == {0}


def test_triangles_of_a_mesh_that_share_a_plane_share_a_face():
    polygons = polygons_of(Mesh(mesh_of(Box((1, 2, 3))).vertices_m + 0.3, mesh_of(Box((1, 2, 3))).triangles))
    assert len(set(polygons.faces.tolist())) == 6
    for face in set(polygons.faces.tolist()):
        normals = [area_vector(c) for c, f in zip(corners_of(polygons), polygons.faces, strict=True) if f == face]
        assert len(np.unique(np.round([n / np.linalg.norm(n) for n in normals], 9), axis=0)) == 1


def test_a_scene_tells_link_shape_and_face_of_each():
    shapes = [
        Shape("w", Box((1, 1, 1)), SE3.trans(x_m=5.0), "first", "steel"),
        Shape("arm", Cylinder(1, 1), SE3.identity()),
        Shape("w", Box((1, 1, 1)), SE3.identity(), "second"),
    ]
    scene = scene_of(shapes)
    assert (scene.links, scene.names, scene.materials) == (("w", "arm"), ("first", "arm", "second"), ("steel", "", ""))
    assert scene.num_faces == 6 + 34 + 6
    assert scene.shape.tolist() == [0] * 6 + [1] * 34 + [2] * 6
    assert scene.shape_link.tolist() == [0, 1, 0]
    assert scene.face[:6].tolist() == list(range(6))
    first = scene.vertices_m[: scene.starts[6]]
    assert (first[:, 0].min(), first[:, 0].max()) == (4.5, 5.5)
    assert scene.starts[-1] == len(scene.vertices_m) == 24 + 32 * 4 + 2 * 32 + 24


def test_a_scene_may_be_empty():
    scene = scene_of([])
    assert (scene.num_faces, scene.starts.tolist(), scene.vertices_m.shape) == (0, [0], (0, 3))
