import numpy as np
import pytest

from services.sim.physics import Physics
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.messaging.messages import Foot
from shared.runtime.config import DynamicsConfig
from shared.solids import Box, Cylinder, Mesh
from shared.world.structure import Member, Structure
from tests.support.robots import MODEL, NOTHING, URDF


def fine_slab() -> Mesh:
    """A slab, 1 m x 1 m x 0.1 m, whose top is cut into 45,000 triangles: more than one body of steel holds."""
    side = np.linspace(-0.5, 0.5, 151)
    x, y = np.meshgrid(side, side)
    top = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.05)])
    corner = (np.arange(150)[:, None] * 151 + np.arange(150)).ravel()
    quads = np.stack([corner, corner + 1, corner + 152, corner + 151], axis=1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    bottom = mesh_of(Box((1.0, 1.0, 0.1)))
    return Mesh(
        np.concatenate([top, bottom.vertices_m]),
        np.concatenate([triangles, bottom.triangles.astype(int) + len(top)]).astype(np.uint32),
    )


@pytest.mark.parametrize("solid", [Box((1, 1, 0.1)), Cylinder(0.6, 0.1), fine_slab()], ids=["box", "tube", "mesh"])
def test_steel_of_any_shape_bears_the_robot(solid):
    structure = Structure("s", (Member("slab", solid, SE3.trans(z_m=-0.05)),), None)
    physics = Physics(URDF, MODEL, structure, DynamicsConfig(), 1e-3)
    physics.place(Foot.A, SE3.trans(z_m=0.03))
    for _ in range(600):
        physics.drive(np.zeros(8), np.zeros(8))
        physics.step()
    height_m = physics.T_world_foot(Foot.A).translation[2]
    physics.engine.close()
    assert height_m == pytest.approx(0.005, abs=5e-4)


def test_without_steel_it_falls_freely():
    physics = Physics(URDF, MODEL, NOTHING, DynamicsConfig(gravity_mps2=2.0), 1e-3)
    physics.place(Foot.B, SE3.trans(z_m=1.0))
    for _ in range(1000):
        physics.drive(np.zeros(8), np.zeros(8))
        physics.step()
    assert physics.T_world_foot(Foot.B).translation[2] == pytest.approx(0.0, abs=5e-3)
    physics.engine.close()


def test_a_hold_can_be_moved_and_its_wrench_is_in_the_foots_frame():
    T = SE3.from_rpy((0.4, -0.7, 1.1), (1.0, 2.0, 3.0))
    physics = Physics(URDF, MODEL, NOTHING, DynamicsConfig(), 1e-3)
    physics.place(Foot.B, T)
    physics.hold(Foot.B, T)
    moved = T @ SE3.trans(x_m=1e-3)
    physics.hold(Foot.B, moved)
    for _ in range(1000):
        physics.drive(np.zeros(8), np.zeros(8))
        physics.step()
    error = moved.inv() @ physics.T_world_foot(Foot.B)
    physics.wrenches()
    physics.step()
    wrench = physics.wrenches()[Foot.B]
    physics.engine.close()
    assert np.abs(error.log()).max() < 5e-5
    np.testing.assert_allclose(T.rotation @ wrench[:3], [0, 0, 4.647 * 9.81], atol=0.2)
