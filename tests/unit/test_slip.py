import numpy as np
import pytest

from services.sim.slip import Slip
from shared.geometry import SE3
from shared.messaging.messages import Foot, JointState, JointTarget, LegState, LegTarget, Transforms
from shared.robot.kinematics import T_fixed_free
from shared.runtime.config import EncoderConfig, SimConfig, SlipConfig
from tests.support.robots import T_world_foot, last, only, running

SLIPPERY = SlipConfig(slide_m=0.002, turn_deg=0.3)


def test_by_default_nothing_slips():
    np.testing.assert_array_equal(Slip(SlipConfig(), np.random.default_rng(1)).next().matrix, np.eye(4))


def test_slips_stay_in_the_plane_of_the_sole():
    slip = Slip(SLIPPERY, np.random.default_rng(1))
    twists = np.array([slip.next().log() for _ in range(3000)])
    np.testing.assert_array_equal(twists[:, 2:5], 0.0)
    np.testing.assert_allclose(twists.std(axis=0)[:2], 0.002, rtol=0.05)
    assert np.rad2deg(twists[:, 5].std()) == pytest.approx(0.3, rel=0.05)


def test_the_same_seed_slips_the_same():
    first, second = Slip(SLIPPERY, np.random.default_rng(1)), Slip(SLIPPERY, np.random.default_rng(2))
    second.reseed(np.random.default_rng(1))
    np.testing.assert_array_equal(first.next().matrix, second.next().matrix)


def leg_odometry_error(seed: int, num_changes: int = 8) -> tuple[float, float]:
    """Metres and radians by which encoders and a foot that is thought to stand still miss the truth after a walk."""
    encoders = EncoderConfig(bias_rad=0.005, noise_rad=0.002, piston_bias_m=0.0005, piston_noise_m=0.0002)
    config = SimConfig(rate_hz=10, encoders=encoders, slip=SLIPPERY)
    rng, foot = np.random.default_rng(seed), Foot.A
    with running(config, seed=seed) as sim:
        T_world_believed = SE3.from_xyz_quat_xyzw(only(LegState, sim.start()).T_world_foot)
        for _ in range(num_changes):
            sim.set_joint_target(JointTarget(q=rng.uniform(-0.5, 0.5, 8) * [1, 0.04, 1, 1, 1, 1, 0.04, 1]))
            states = [message for _ in range(12) for message in sim.step()]
            T_world_believed = T_world_believed @ T_fixed_free(last(JointState, states).q, foot)
            foot = foot.other
            sim.set_fixed_foot(LegTarget(foot=foot))
        T_world_true = T_world_foot(last(Transforms, sim.step()), foot)
    error = T_world_true.inv() @ T_world_believed
    return float(np.linalg.norm(error.translation)), error.angle_rad


def test_leg_odometry_drifts_by_millimetres():
    errors = np.array([leg_odometry_error(seed) for seed in range(8)])
    assert 0.003 < np.median(errors[:, 0]) < 0.03
    assert 0.3 < np.rad2deg(np.median(errors[:, 1])) < 3.0


def test_drives_go_where_their_encoders_say():
    config = SimConfig(encoders=EncoderConfig(bias_rad=0.01, piston_bias_m=0.001))
    q = np.array([0.1, 0.01, -0.2, 0.3, 0.1, 0.2, -0.01, 0.1])
    with running(config, seed=3) as sim:
        start = sim.start()
        bias = only(JointState, start).q
        assert (bias != 0).all()
        np.testing.assert_allclose(
            T_world_foot(only(Transforms, start), Foot.B).translation, [0, -0.625, 10.105], atol=1e-12
        )
        sim.set_joint_target(JointTarget(q=q))
        messages = [message for _ in range(100) for message in sim.step()]
    np.testing.assert_allclose(last(JointState, messages).q, q, atol=1e-12)
    T_world_A = SE3.from_rpy((0, 0, np.pi / 2), (0.0, -0.775, 10.105))
    expected = T_world_A @ T_fixed_free(q - bias, Foot.A)
    np.testing.assert_allclose(T_world_foot(last(Transforms, messages), Foot.B).matrix, expected.matrix, atol=1e-9)
