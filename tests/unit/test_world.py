import numpy as np
import pytest

from services.sim.world import World
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.messaging.messages import JOINT_NAMES
from shared.robot.urdf import read_urdf
from shared.runtime.config import CONFIGS_DIR
from shared.solids import Box, Cylinder, Mesh
from shared.world.structure import Member, Structure

URDF = read_urdf(CONFIGS_DIR / "robot" / "hyrecro.urdf")


@pytest.mark.parametrize("solid", [Box((0.4, 0.4, 0.2)), Cylinder(0.2, 0.2), mesh_of(Box((0.4, 0.4, 0.2)))])
@pytest.mark.parametrize(("gap_m", "is_near"), [(0.0, True), (0.008, True), (0.012, False)])
def test_steel_of_any_shape_is_near_where_it_is(solid, gap_m, is_near):
    below_sole = SE3.trans(z_m=-0.005 - gap_m - 0.1)
    world = World(URDF, JOINT_NAMES, Structure("s", (Member("b", solid, below_sole),), None))
    world.place(np.zeros(8), np.zeros(8), "foot_a", SE3.identity())
    assert world.is_near_steel("foot_a", 0.01) == is_near
    world.close()


def test_a_mesh_that_is_too_fine_for_pybullet_is_named():
    mesh = mesh_of(Box((1.0, 1.0, 1.0)))
    fine = Mesh(mesh.vertices_m, np.resize(mesh.triangles, (174763, 3)))
    with pytest.raises(InputFileError, match="member 'b': 8 vertices and 174763 triangles; pybullet takes at most"):
        World(URDF, JOINT_NAMES, Structure("s", (Member("b", fine, SE3.identity()),), None))
