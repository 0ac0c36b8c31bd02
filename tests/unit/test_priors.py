"""What predicts the sensor's motion, against motions that are known."""

import numpy as np
import pytest

from services.mapper.postures import Postures, mount_of
from services.mapper.priors.constant_velocity import ConstantVelocity
from services.mapper.priors.inertial import Inertial
from services.mapper.priors.interface import increment
from services.mapper.priors.known_trajectory import KnownTrajectory
from services.mapper.priors.leg_odometry import LegOdometry
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import Foot, Imu, JointState, JointTarget, LegState, LegTarget, Transforms
from tests.support.robots import MODEL, ORIGINAL, run, running

MS = 1_000_000
TWIST = np.array([0.2, -0.1, 0.05, 0.1, 0.4, -0.8])


def assert_same(found: SE3, true: SE3, metres: float, radians: float) -> None:
    error = true.inv() @ found
    assert np.linalg.norm(error.translation) < metres
    assert error.angle_rad < radians


# ---- constant velocity


def test_a_trend_goes_on_also_within_a_scan():
    prior = ConstantVelocity()
    start = SE3.exp([1.0, 2.0, 3.0, 0.3, -0.2, 0.1])
    for k in range(2):
        prior.correct(100 * MS * k, start @ SE3.exp(TWIST * 0.1 * k))
    motion = prior.motion(100 * MS, 400 * MS)
    for end_ms in (130, 200, 400):
        assert_same(increment(motion, 100 * MS, end_ms * MS), SE3.exp(TWIST * (end_ms - 100) / 1000), 2e-4, 1e-9)


def test_a_trend_begins_at_rest_and_rests_after_a_lost_scan():
    prior = ConstantVelocity()
    assert prior.motion(0, MS) is None
    prior.correct(0, SE3.identity())
    assert_same(increment(prior.motion(0, 100 * MS), 0, 100 * MS), SE3.identity(), 1e-12, 1e-12)
    prior.correct(100 * MS, SE3.trans(0.1))
    assert_same(increment(prior.motion(100 * MS, 200 * MS), 100 * MS, 200 * MS), SE3.trans(0.1), 1e-9, 1e-9)
    prior.correct(200 * MS, None)
    assert_same(increment(prior.motion(200 * MS, 300 * MS), 200 * MS, 300 * MS), SE3.identity(), 1e-12, 1e-12)


# ---- IMU


def imu(stamp_ns: int, rate) -> Imu:
    return Imu(
        stamp_ns=stamp_ns, seq=0, frame="lidar", angular_velocity_radps=rate, linear_acceleration_mps2=[0, 0, 9.81]
    )


def turning(prior: Inertial, rate, until_ms: int, bias=(0.0, 0.0, 0.0)) -> None:
    for stamp_ms in range(0, until_ms + 1, 10):
        prior.add_imu(imu(stamp_ms * MS, np.add(rate, bias)))


def test_the_gyroscope_turns_and_the_last_velocity_moves():
    prior, rate = Inertial(), np.array([0.5, -0.2, 1.0])
    turning(prior, rate, 300)
    assert prior.motion(100 * MS, 200 * MS) is None
    for k in range(2):
        prior.correct(100 * MS * k, SE3.exp([0, 0, 0, *(rate * 0.1 * k)]) @ SE3.identity())
    moved = SE3(SE3.exp([0, 0, 0, *(rate * 0.2)]).rotation, np.array([0.0, 0.02, 0.0]))
    prior.correct(200 * MS, moved)
    after = SE3(SE3.exp([0, 0, 0, *(rate * 0.3)]).rotation, np.array([0.0, 0.04, 0.0]))
    assert_same(increment(prior.motion(200 * MS, 300 * MS), 200 * MS, 300 * MS), moved.inv() @ after, 1e-9, 1e-9)


def test_a_bias_is_learnt_from_where_the_sensor_is_found():
    prior = Inertial()
    turning(prior, (0.0, 0.0, 0.0), 6000, bias=(0.02, -0.01, 0.03))
    for k in range(60):
        prior.correct(100 * MS * k, SE3.identity())
    turn = increment(prior.motion(5900 * MS, 6000 * MS), 5900 * MS, 6000 * MS)
    assert turn.angle_rad < 0.02 * 0.1 * 0.04


@pytest.mark.parametrize(("start_ms", "end_ms"), [(-200, 0), (250, 500)])
def test_missing_readings_say_nothing(start_ms, end_ms):
    prior = Inertial()
    turning(prior, (0.0, 0.0, 1.0), 300)
    prior.correct(0, SE3.identity())
    assert prior.motion(start_ms * MS, end_ms * MS) is None


# ---- a trajectory from elsewhere


def test_only_the_steps_of_a_known_trajectory_count():
    poses = [SE3.exp(TWIST * k) for k in range(3)]
    prior = KnownTrajectory([(k * 1000 * MS, SE3.trans(5.0) @ pose) for k, pose in enumerate(poses)])
    step = increment(prior.motion(1000 * MS, 2000 * MS), 1000 * MS, 2000 * MS)
    assert_same(step, SE3.exp(TWIST), 1e-9, 1e-9)
    assert prior.motion(1000 * MS, 2001 * MS) is None


# ---- legs


@pytest.fixture(scope="module")
def climb():
    """Joints, legs and true transforms of a short motion on either foot."""
    with running(structure=ORIGINAL) as sim:
        messages = [*sim.start()]
        messages += sim.set_joint_target(JointTarget(q=[0.1, 0.0, -0.2, 0.4, -0.3, 0.2, 0.01, -0.1]))
        messages += run(sim, 0.8)
        messages += sim.set_fixed_foot(LegTarget(foot=Foot.B))
        messages += run(sim, 0.1)
        messages += sim.set_joint_target(JointTarget(q=[-0.2, 0.01, 0.1, -0.2, 0.5, -0.1, 0.0, 0.2]))
        return messages + run(sim, 0.8)


def fed(messages):
    postures = Postures()
    postures.mount = mount_of(MODEL, "lidar")
    legs = LegOdometry(postures)
    for message in messages:
        if isinstance(message, JointState):
            postures.add(message)
        if isinstance(message, LegState):
            legs.add_leg_state(message)
    return legs


def test_legs_know_the_way_through_a_change_of_foot(climb):
    legs = fed(climb)
    true = {each.stamp_ns: FrameTree(each).T_root("lidar") for each in climb if isinstance(each, Transforms)}
    feet = {each.fixed_foot for each in climb if isinstance(each, LegState)}
    start_ns, end_ns = min(true), max(true)
    assert feet == {Foot.A, Foot.B}
    motion = legs.motion(start_ns, end_ns)
    way = true[start_ns].inv() @ true[end_ns]
    assert way.angle_rad > 0.1
    for stamp_ns in list(true)[::20]:
        assert_same(increment(motion, start_ns, stamp_ns), true[start_ns].inv() @ true[stamp_ns], 1e-6, 1e-6)


def test_legs_say_nothing_before_joints_and_feet_are_known(climb):
    assert fed([]).motion(0, 10 * MS) is None
    assert fed([each for each in climb if isinstance(each, JointState)]).motion(0, 10 * MS) is None
    assert fed([each for each in climb if isinstance(each, LegState)]).motion(0, 10 * MS) is None
    legs = fed(climb)
    last_ns = max(each.stamp_ns for each in climb if isinstance(each, JointState))
    assert legs.motion(last_ns - MS, last_ns + 200 * MS) is None


def test_a_frame_that_the_robot_does_not_carry_has_no_mount():
    with pytest.raises(InputFileError, match="'os_sensor' is not fixed to any of foot_a, "):
        mount_of(MODEL, "os_sensor")


def test_a_change_of_foot_that_nobody_saw_breaks_the_way(climb):
    """The joints may have moved since: their posture then does not tell where the other foot stands."""
    change_ns = next(each.stamp_ns for each in climb if isinstance(each, LegState) and each.fixed_foot is Foot.B)
    away = range(change_ns - 400 * MS, change_ns + 200 * MS)
    legs = fed([each for each in climb if each.stamp_ns not in away])
    end_ns = max(each.stamp_ns for each in climb)
    assert legs.step(away.start - 100 * MS, end_ns) is None
    assert legs.motion(away.start - 100 * MS, end_ns) is None
    true = {each.stamp_ns: FrameTree(each).T_root("lidar") for each in climb if isinstance(each, Transforms)}
    start_ns = away.stop + 100 * MS
    assert_same(legs.step(start_ns, end_ns), true[start_ns].inv() @ true[end_ns], 1e-6, 1e-6)


def test_legs_that_were_restored_bridge_the_silence(climb):
    died_ns, back_ns = 300 * MS, 600 * MS
    before = fed([each for each in climb if each.stamp_ns <= died_ns])
    postures = Postures()
    postures.mount = mount_of(MODEL, "lidar")
    after = LegOdometry(postures)
    postures.restore(before._postures.snapshot(died_ns))
    after.restore(before.snapshot())
    for each in climb:
        if each.stamp_ns >= back_ns and isinstance(each, JointState | LegState):
            postures.add(each) if isinstance(each, JointState) else after.add_leg_state(each)
    true = {each.stamp_ns: FrameTree(each).T_root("lidar") for each in climb if isinstance(each, Transforms)}
    end_ns = max(true)
    assert_same(after.step(died_ns, end_ns), true[died_ns].inv() @ true[end_ns], 1e-6, 1e-6)
