import numpy as np
import pytest

from services.sensors.bodies import link_meshes
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.robot.description import Shape
from shared.solids import Box, Cylinder, Sphere


def volume_m3(mesh):
    """By the divergence theorem: right only if the mesh is closed and wound outwards."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize(
    ("solid", "expected_m3", "tolerance"),
    [
        (Box((0.2, 0.3, 0.5)), 0.03, 1e-12),
        (Cylinder(0.1, 2.0), np.pi * 0.01 * 2.0, 0.01),
        (Sphere(0.5), np.pi * 0.5**3 * 4 / 3, 0.02),
    ],
)
def test_meshes_are_closed_and_wound_outwards(solid, expected_m3, tolerance):
    assert volume_m3(mesh_of(solid)) == pytest.approx(expected_m3, rel=tolerance)


def test_shapes_of_a_link_become_one_mesh_in_its_frame():
    shapes = [Shape("a", Box((1, 1, 1)), SE3.trans(x_m=5.0)), Shape("b", Box((1, 1, 1)), SE3.identity())]
    meshes = link_meshes([*shapes, Shape("a", Box((1, 1, 1)), SE3.trans(x_m=-5.0))])
    assert set(meshes) == {"a", "b"}
    assert volume_m3(meshes["a"]) == pytest.approx(2.0)
    assert sorted(set(meshes["a"].triangles.ravel().tolist())) == list(range(16))
    assert (meshes["a"].vertices_m[:, 0].min(), meshes["a"].vertices_m[:, 0].max()) == (-5.5, 5.5)
