import numpy as np
import pytest

from services.sensors.bodies import Labels
from services.sensors.lidar import LidarScanner
from shared.errors import MessageError
from shared.geometry import SE3
from shared.meshes import faces_of, mesh_of
from shared.messaging.messages import RobotDescription, StructureDescription, Transforms
from shared.robot.description import Shape
from shared.runtime.config import LidarConfig
from shared.solids import Box, Cylinder, Mesh, Sphere
from tests.support.robots import ORIGINAL, only, running

NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])


def normals_of(mesh):
    a, b, c = np.moveaxis(mesh.vertices_m[mesh.triangles], 1, 0)
    across = np.cross(b - a, c - a)
    return across / np.linalg.norm(across, axis=1, keepdims=True)


def test_faces_of_a_box_are_in_the_order_of_its_axes():
    box = Box((1, 2, 3))
    np.testing.assert_allclose(normals_of(mesh_of(box)), NORMALS[faces_of(box)], atol=1e-12)


def test_faces_of_a_cylinder_are_side_bottom_and_top():
    cylinder = Cylinder(0.5, 2.0)
    normals, faces = normals_of(mesh_of(cylinder)), faces_of(cylinder)
    np.testing.assert_allclose(normals[faces == 0, 2], 0, atol=1e-12)
    np.testing.assert_allclose(normals[faces == 1, 2], -1)
    np.testing.assert_allclose(normals[faces == 2, 2], 1)
    assert set(faces_of(Sphere(1.0))) == {0}


def test_triangles_of_a_mesh_that_share_a_plane_share_a_face():
    box = mesh_of(Box((1, 2, 3)))
    faces = faces_of(Mesh(box.vertices_m + 0.3, box.triangles))
    assert len(set(faces.tolist())) == 6
    for face in set(faces.tolist()):
        assert len(np.unique(normals_of(box)[faces == face].round(9), axis=0)) == 1


def test_a_hit_is_told_by_its_body_and_triangle():
    shapes = [
        Shape("w", Box((1, 1, 1)), SE3.identity(), "first"),
        Shape("arm", Box((1, 1, 1)), SE3.identity()),
        Shape("w", Cylinder(1, 1), SE3.identity(), "second"),
    ]
    labels = Labels(shapes)
    assert labels.names == ("first", "arm", "second")
    hits = labels.of(["w", "arm"], np.array([0, 0, 1]), np.array([5, 12 + 70, 3]))
    assert hits.tolist() == [[0, 5], [2, 1], [1, 3]]


def test_every_point_of_a_scan_lies_on_the_face_it_is_said_to_lie_on():
    config = LidarConfig(num_columns=128, num_rings=32, range_noise_m=0.0)
    scanner = LidarScanner(config, np.random.default_rng(1))
    with running(structure=ORIGINAL) as sim:
        messages = sim.start()
    transforms = only(Transforms, messages)
    with pytest.raises(MessageError, match="needs the descriptions"):
        scanner.scan(transforms)
    scanner.set_robot(only(RobotDescription, messages))
    scanner.set_structure(only(StructureDescription, messages))
    scan, labels = scanner.scan(transforms)
    names = scanner.label_names
    assert {"ground", "hip"} & {names[i] for i in labels[:, 0]} == set(), "the original stands ten metres high"
    T_world_lidar = SE3.from_rpy((0, 0, np.pi / 2), (0.0, -0.7, 10.4615))
    points = T_world_lidar.apply(scan.points_m.astype(np.float64))
    seen = set()
    for number, face in np.unique(labels, axis=0).tolist():
        if names[number].startswith(("post", "beam")):
            member = next(member for member in ORIGINAL.members if member.name == names[number])
            local = member.T_world_member.inv().apply(points[(labels == (number, face)).all(axis=1)])
            half = np.array(member.solid.size_m) / 2
            np.testing.assert_allclose(local @ NORMALS[face], half @ np.abs(NORMALS[face]), atol=2e-4)
            assert (np.abs(local) <= half + 2e-4).all()
            seen.add(names[number])
    assert len(seen) > 8
    assert np.bincount(labels[:, 0]).sum() == len(scan.points_m)
