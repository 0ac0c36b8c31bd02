import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from services.sim.quiet_pybullet import pybullet
from shared.geometry import SE3
from shared.messaging.messages import JOINT_NAMES, Foot
from shared.robot.description import Inertia
from shared.robot.jacobian import foot_jacobian
from shared.robot.kinematics import HYRECRO, LINKS, T_fixed_free, link_matrices
from shared.robot.statics import RobotMasses, gravity_efforts, holding_wrench
from shared.runtime.config import CONFIGS_DIR
from tests.support.postures import MODEL, postures, random_postures

MASSES = RobotMasses.from_urdf(MODEL)
FLOOR = np.eye(3)
TILTED = SE3.from_rpy([0.4, -1.1, 2.0]).rotation


def only(link, mass_kg, centre_m=(0.0, 0.0, 0.0)):
    is_link = np.array(LINKS) == link
    return RobotMasses(mass_kg * is_link, np.outer(is_link, centre_m))


def potential(q, fixed_foot, R_world_fixed, masses, gravity_mps2=9.81):
    """In J, by adding up every link by itself."""
    T_fixed_footA = SE3.identity() if fixed_foot is Foot.A else T_fixed_free(q, Foot.B)
    energy = 0.0
    for T_footA_link, mass_kg, centre_m in zip(link_matrices(q), masses.mass_kg, masses.centre_m, strict=True):
        point = T_fixed_footA @ SE3.from_matrix(T_footA_link) @ SE3(np.eye(3), centre_m)
        energy += mass_kg * gravity_mps2 * (R_world_fixed @ point.translation)[2]
    return energy


def test_the_masses_of_the_urdf():
    # feet 0.8, half legs 0.3, platforms 0.3, hip 0.8 with the sensor's 0.447 at z = 0.0915 - 0.05
    np.testing.assert_allclose(MASSES.mass_kg, [0.8, 0.3, 0.3, 0.3, 1.247, 0.3, 0.3, 0.3, 0.8])
    assert MASSES.total_kg == pytest.approx(4.647)
    np.testing.assert_allclose(MASSES.centre_m[LINKS.index("hip")], [0.075, 0, 0.447 * 0.0415 / 1.247])
    np.testing.assert_allclose(MASSES.centre_m[LINKS.index("foot_b")], [0, 0, -0.025])


def test_a_mass_that_hangs_on_nothing_known_is_refused():
    stray = dataclasses.replace(MODEL, inertias={"arm": Inertia(1.0, SE3.identity(), np.eye(3))})
    with pytest.raises(ValueError, match="link 'arm' has a mass and is fixed to none of foot_a"):
        RobotMasses.from_urdf(stray)
    with pytest.raises(ValueError, match=r"masses must be \(9,\) and \(9, 3\), got \(8,\)"):
        RobotMasses(np.ones(8), np.zeros((8, 3)))
    with pytest.raises(ValueError, match="not negative"):
        RobotMasses(-np.ones(9), np.zeros((9, 3)))


def test_a_kilogram_in_foot_b_beside_foot_a():
    masses = only("foot_b", 1.0, (0, 0, -0.025))
    np.testing.assert_allclose(
        holding_wrench(np.zeros(8), Foot.A, FLOOR, masses), [0, 0, 9.81, 0, -9.81 * 0.15, 0], atol=1e-12
    )
    np.testing.assert_allclose(holding_wrench(np.zeros(8), Foot.B, FLOOR, masses), [0, 0, 9.81, 0, 0, 0], atol=1e-12)


def test_on_a_wall_the_whole_lever_is_above_the_sole():
    # x of the foot up: 2 kg in the hip's middle, 0.265 above the plate and 0.270 above the sole, 0.075 up the wall
    R_world_fixed = SE3.rot("y", -np.pi / 2).rotation
    masses = only("hip", 2.0, HYRECRO.T_hip_plate.translation)
    wrench = holding_wrench(np.zeros(8), Foot.A, R_world_fixed, masses, gravity_mps2=10.0)
    np.testing.assert_allclose(wrench, [20, 0, 0, 0, 20 * 0.270, 0], atol=1e-12)


def test_joints_bear_what_is_beyond_them():
    masses = only("foot_b", 1.0, (0, 0, -0.025))
    # leg A carries 1 kg, leg B hangs it; q1's and q3's axis is -y, the weight is 0.15 m along x: it would turn about +y
    expected = [9.81 * 0.15, 9.81, 9.81 * 0.15, 0, 0, 0, -9.81, 0]
    np.testing.assert_allclose(gravity_efforts(np.zeros(8), Foot.A, FLOOR, masses), expected, atol=1e-12)
    np.testing.assert_allclose(gravity_efforts(np.zeros(8), Foot.B, FLOOR, masses), np.zeros(8), atol=1e-12)


@settings(max_examples=30)
@given(postures, st.sampled_from(Foot), st.sampled_from([FLOOR, TILTED]))
def test_efforts_are_the_derivatives_of_the_potential(q, fixed_foot, R_world_fixed):
    h = 1e-5
    expected = [
        (
            potential(q + step, fixed_foot, R_world_fixed, MASSES)
            - potential(q - step, fixed_foot, R_world_fixed, MASSES)
        )
        / (2 * h)
        for step in h * np.eye(8)
    ]
    np.testing.assert_allclose(gravity_efforts(q, fixed_foot, R_world_fixed, MASSES), expected, atol=1e-7)


@settings(max_examples=30)
@given(postures, st.sampled_from(Foot), st.sampled_from([FLOOR, TILTED]))
def test_moving_the_sole_does_the_work_of_the_wrench(q, fixed_foot, R_world_fixed):
    """Virtual work: a small turn about the sole's centre or shift of the whole robot changes the potential by it."""
    wrench = holding_wrench(q, fixed_foot, R_world_fixed, MASSES)
    T_fixed_sole = SE3.trans(z_m=-0.005)
    h = 1e-5

    def energy(twist):
        T_fixed_moved = T_fixed_sole @ SE3.exp(twist) @ T_fixed_sole.inv()
        R = R_world_fixed @ T_fixed_moved.rotation
        shift_m = (R_world_fixed @ T_fixed_moved.translation)[2]
        return potential(q, fixed_foot, R, MASSES) + MASSES.total_kg * 9.81 * shift_m

    expected = [(energy(twist) - energy(-twist)) / (2 * h) for twist in h * np.eye(6)]
    np.testing.assert_allclose(wrench, expected, atol=1e-6)


def test_the_feet_share_nothing_but_the_weight():
    q = random_postures(1)[0]
    T_A_B = T_fixed_free(q, Foot.A)
    at_a = holding_wrench(q, Foot.A, TILTED, MASSES)
    at_b = holding_wrench(q, Foot.B, TILTED @ T_A_B.rotation, MASSES)
    np.testing.assert_allclose(T_A_B.rotation @ at_b[:3], at_a[:3], atol=1e-12)
    soles = [T.translation - 0.005 * T.rotation[:, 2] for T in (SE3.identity(), T_A_B)]
    moved = T_A_B.rotation @ at_b[3:] + np.cross(soles[1] - soles[0], at_a[:3])
    np.testing.assert_allclose(moved, at_a[3:], atol=1e-12)


def test_efforts_follow_from_the_free_foot_s_jacobian():
    masses = only("foot_b", 1.3, (0, 0, -0.025))
    q = random_postures(50)
    weight = TILTED.T @ [0, 0, -1.3 * 9.81]
    expected = -foot_jacobian(q, Foot.A)[:, :3].swapaxes(1, 2) @ weight
    np.testing.assert_allclose(gravity_efforts(q, Foot.A, TILTED, masses), expected, atol=1e-12)


def test_the_physics_engine_finds_the_same_efforts():
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setGravity(*(TILTED.T @ [0, 0, -9.81]), physicsClientId=client)
        path = str(CONFIGS_DIR / "robot" / "hyrecro.urdf")
        body = pybullet.loadURDF(path, useFixedBase=True, physicsClientId=client)
        num_joints = pybullet.getNumJoints(body, physicsClientId=client)
        infos = [pybullet.getJointInfo(body, i, physicsClientId=client) for i in range(num_joints)]
        assert [info[1].decode() for info in infos if info[2] != pybullet.JOINT_FIXED] == list(JOINT_NAMES)
        for q in random_postures(20):
            zeros = [0.0] * 8
            efforts = pybullet.calculateInverseDynamics(body, q.tolist(), zeros, zeros, physicsClientId=client)
            np.testing.assert_allclose(gravity_efforts(q, Foot.A, TILTED, MASSES), efforts, atol=1e-6)
    finally:
        pybullet.disconnect(client)


@pytest.mark.parametrize("fixed_foot", Foot)
def test_many_postures_at_once(fixed_foot):
    q = random_postures(6).reshape(2, 3, 8)
    R = np.stack([FLOOR, TILTED])[:, None]
    wrenches = holding_wrench(q, fixed_foot, R, MASSES)
    efforts = gravity_efforts(q, fixed_foot, R, MASSES)
    assert wrenches.shape == (2, 3, 6)
    assert efforts.shape == (2, 3, 8)
    assert holding_wrench(q[0, 0], fixed_foot, R[:, 0], MASSES).shape == (2, 6)
    for i, j in np.ndindex(2, 3):
        np.testing.assert_allclose(wrenches[i, j], holding_wrench(q[i, j], fixed_foot, R[i, 0], MASSES), atol=1e-12)
        np.testing.assert_allclose(efforts[i, j], gravity_efforts(q[i, j], fixed_foot, R[i, 0], MASSES), atol=1e-12)
