import numpy as np
import pytest

from shared.geometry import SE3
from shared.meshes import area_m2, is_closed, mesh_of, volume_m3
from shared.solids import Box, Cylinder, Mesh, Sphere


@pytest.mark.parametrize(
    ("solid", "expected_m3", "tolerance"),
    [
        (Box((0.2, 0.3, 0.5)), 0.03, 1e-12),
        (Cylinder(0.1, 2.0), np.pi * 0.01 * 2.0, 0.01),
        (Sphere(0.5), np.pi * 0.5**3 * 4 / 3, 0.02),
    ],
)
def test_meshes_are_closed_and_wound_outwards(solid, expected_m3, tolerance):
    mesh = mesh_of(solid)
    assert volume_m3(mesh) == pytest.approx(expected_m3, rel=tolerance)
    assert volume_m3(mesh.moved(SE3.trans(1e3))) == pytest.approx(expected_m3, rel=tolerance)
    assert volume_m3(Mesh(mesh.vertices_m, mesh.triangles[:, ::-1])) == pytest.approx(-expected_m3, rel=tolerance)


def test_a_mesh_is_closed_if_each_edge_has_its_neighbour():
    mesh = mesh_of(Box((1.0, 2.0, 3.0)))
    assert is_closed(mesh)
    assert not is_closed(Mesh(mesh.vertices_m, mesh.triangles[1:]))
    assert not is_closed(Mesh(mesh.vertices_m, np.concatenate([mesh.triangles, mesh.triangles])))
    assert not is_closed(Mesh(mesh.vertices_m, np.concatenate([mesh.triangles[:1, ::-1], mesh.triangles[1:]])))


def test_the_area_of_a_box():
    assert area_m2(mesh_of(Box((1.0, 2.0, 3.0)))) == pytest.approx(22.0)
