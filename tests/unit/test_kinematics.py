import numpy as np
import pytest
from hypothesis import given, strategies as st

from services.sim.engine import Engine
from shared.geometry import SE3
from shared.messaging.messages import JOINT_NAMES, Foot
from shared.robot.kinematics import (
    FOOT_LINKS,
    HYRECRO,
    LINKS,
    T_fixed_free,
    T_footA_footB,
    T_footA_hip,
    foot_matrices,
    link_matrices,
    link_transforms,
)
from shared.robot.urdf import parse_urdf, read_urdf
from shared.runtime.config import CONFIGS_DIR

URDF = read_urdf(CONFIGS_DIR / "robot" / "hyrecro.urdf")
MODEL = parse_urdf(URDF, "hyrecro.urdf")

postures = st.tuples(*(st.floats(MODEL.limits[name].lower, MODEL.limits[name].upper) for name in JOINT_NAMES))


def test_at_zero_the_feet_stand_side_by_side():
    np.testing.assert_allclose(T_footA_footB(np.zeros(8)).matrix, SE3.trans(x_m=0.15).matrix, atol=1e-15)
    np.testing.assert_allclose(T_footA_hip(np.zeros(8)).matrix, SE3.trans(0.075, 0, 0.265).matrix, atol=1e-15)


def test_a_wide_stand():
    T = T_footA_footB([-0.6, 0, 0.6, 0, 0, 0.6, 0, -0.6])
    np.testing.assert_allclose(T.rotation, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(T.translation, [0.370211, 0, 0], atol=5e-7)


def test_from_a_floor_to_a_wall():
    T = T_footA_footB([0.09958849, 0, -0.47375217, np.pi, np.pi, -0.80456188, 0, -0.39678315])
    pitch_deg = np.rad2deg(np.arctan2(-T.rotation[2, 0], T.rotation[0, 0]))
    assert pitch_deg == pytest.approx(90.27, abs=5e-3)
    np.testing.assert_allclose(T.translation, [-0.364213, 0, 0.199466], atol=5e-7)


def test_a_posture_that_moves_every_joint():
    q = [0.3, 0.02, -0.2, 0.5, -0.9, 0.4, -0.01, 0.25]
    np.testing.assert_allclose(T_footA_footB(q).translation, [0.166331, 0.037967, 0.062207], atol=5e-7)
    np.testing.assert_allclose(
        T_footA_footB(q).rotation,
        [
            [0.6691607537, 0.3874728726, -0.6341046118],
            [-0.3100096332, 0.9210609940, 0.2356706869],
            [0.6753650221, 0.0388769636, 0.7364581920],
        ],
        atol=1e-10,
    )
    np.testing.assert_allclose(T_footA_hip(q).translation, [-0.0025394753, 0.0359569154, 0.2817434375], atol=1e-10)


@given(postures)
def test_either_foot_may_be_the_fixed_one(q):
    loop = T_fixed_free(q, Foot.A) @ T_fixed_free(q, Foot.B)
    np.testing.assert_allclose(loop.matrix, np.eye(4), atol=1e-14)


@given(postures)
def test_the_urdf_has_the_same_frames(q):
    at = dict(zip(JOINT_NAMES, q, strict=True))
    from_urdf = {joint.child: joint.T_parent_child(at[joint.name]) for joint in MODEL.joints if joint.name in at}
    expected = link_transforms(q)
    assert list(from_urdf) == list(expected)
    for link, T_parent_child in expected.items():
        np.testing.assert_allclose(from_urdf[link].matrix, T_parent_child.matrix, atol=1e-14, err_msg=link)


def test_the_physics_engine_has_the_same_frames():
    world = Engine(URDF, JOINT_NAMES)
    rng = np.random.default_rng(1)
    for q in rng.uniform(-1, 1, (20, 8)) * (1.5, 0.025, 1.5, 3.2, 3.2, 1.5, 0.025, 1.5):
        world.place(q, np.zeros(8), FOOT_LINKS[Foot.A], SE3.identity())
        links = link_transforms(q)
        T_root_link = SE3.identity()
        for link, T_parent_child in links.items():
            T_root_link = T_root_link @ T_parent_child
            np.testing.assert_allclose(world.T_world(link).matrix, T_root_link.matrix, atol=1e-12, err_msg=link)
    world.close()


def test_many_postures_at_once():
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (2, 3, 8))
    T_footA_link = link_matrices(q)
    assert T_footA_link.shape == (2, 3, 9, 4, 4)
    np.testing.assert_array_equal(T_footA_link[..., 0, :, :], np.broadcast_to(np.eye(4), (2, 3, 4, 4)))
    for index in np.ndindex(2, 3):
        T = SE3.identity()
        for link, T_parent_child in link_transforms(q[index]).items():
            T = T @ T_parent_child
            np.testing.assert_allclose(T_footA_link[(*index, LINKS.index(link))], T.matrix, atol=1e-14)
        np.testing.assert_allclose(foot_matrices(q)[index], T_footA_footB(q[index]).matrix, atol=1e-14)


def test_plates_stand_where_the_urdf_shows_them():
    shown = {shape.link: shape.T_link_shape for shape in reversed(MODEL.shapes)}
    np.testing.assert_array_equal(shown["hip"].matrix, HYRECRO.T_hip_plate.matrix)
    for foot, link in FOOT_LINKS.items():
        np.testing.assert_array_equal(shown[link].matrix, HYRECRO.T_link_foot(foot).matrix)


def test_the_sensor_is_above_the_middle_of_the_hip_plate():
    T_hip_lidar = next(joint for joint in MODEL.joints if joint.child == "lidar").T_parent_child()
    np.testing.assert_allclose((HYRECRO.T_hip_plate.inv() @ T_hip_lidar).matrix, SE3.trans(z_m=0.0915).matrix)


def test_rays_that_start_at_the_minimum_range_start_outside_the_sensor():
    (housing,) = (shape for shape in MODEL.shapes if shape.link == "lidar")
    lowest_m = abs(housing.T_link_shape.translation[2]) + housing.solid.length_m / 2
    assert np.hypot(lowest_m, housing.solid.radius_m) < 0.2


def test_wrong_numbers_of_joints_are_refused():
    with pytest.raises(ValueError, match=r"q must be \(8,\), got \(7,\)"):
        link_transforms(np.zeros(7))
    with pytest.raises(ValueError, match=r"q must be \(8,\), got \(2, 8\)"):
        T_footA_footB(np.zeros((2, 8)))
    with pytest.raises(ValueError, match=r"q must be \(\.\.\., 8\), got \(2, 7\)"):
        link_matrices(np.zeros((2, 7)))
