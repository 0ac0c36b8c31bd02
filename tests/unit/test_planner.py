import numpy as np
import pytest

from services.planner.planner import StepPlanner
from services.planner.schedule import Schedule
from services.planner.state import PlannerState
from services.planner.step_planning import StepPlan
from shared.climbing.climber import Climber
from shared.climbing.stance import Stance
from shared.errors import RefusedError
from shared.geometry import SE3
from shared.messaging.channels import JOINTS_TARGET, SIM_CONTROL
from shared.messaging.codec import decode, encode
from shared.messaging.messages import (
    Event,
    Foot,
    FootPhase,
    FootStatus,
    FootTarget,
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    Severity,
    Stop,
)
from shared.runtime.config import PlannerConfig
from tests.support.postures import MODEL
from tests.support.steel import BEAM, structure
from tests.support.stepping import ZERO, at

CLIMBER = Climber.of(MODEL, structure(BEAM))
UP = (0, 0, 1)
NEXT = at((0.4, 0, 0), UP)


class Robot:
    """Carries out what it is told at once; its clock runs in steps of 10 ms."""

    def __init__(self, planner, foot=Foot.A):
        self.planner, self.q, self.stamp_ns = planner, ZERO, 0
        self.stance = Stance(foot, SE3.trans(z_m=0.005))
        self.error = lambda: ZERO
        self.statuses, self.targets, self.leg_targets = [], [], []
        self.take(planner.add_leg_state(self.leg_state()))
        self.tick()

    def leg_state(self):
        pose = self.stance.T_world_foot.xyz_quat_xyzw
        return LegState(stamp_ns=0, seq=0, frame="world", fixed_foot=self.stance.fixed_foot, T_world_foot=pose)

    def take(self, messages):
        for message in messages:
            match message:
                case FootStatus():
                    self.statuses.append(message)
                case JointTarget():
                    self.targets.append((self.stamp_ns, message))
                    self.q = message.q
                case LegTarget():
                    self.leg_targets.append(message.foot)
                    self.stance = self.stance.changed(self.q)
                    self.take(self.planner.add_leg_state(self.leg_state()))

    def tick(self, num=1, step_ns=10_000_000):
        for _ in range(num):
            self.take(
                self.planner.add_joint_state(
                    JointState(stamp_ns=self.stamp_ns, seq=0, frame="", q=self.q + self.error(), dq=ZERO)
                )
            )
            self.stamp_ns += step_ns

    def run(self, step_ns=10_000_000):
        for _ in range(5000):
            if not self.planner.is_busy:
                return
            self.tick(step_ns=step_ns)
        raise AssertionError("the step does not end")

    @property
    def phases(self):
        return list(dict.fromkeys(status.phase for status in self.statuses))


@pytest.fixture
def robot():
    return Robot(StepPlanner(PlannerConfig(), CLIMBER, seed=1))


def test_a_step_goes_through_its_phases_and_ends_where_it_should(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.run()
    wanted = [FootPhase.PLANNING, FootPhase.LIFT, FootPhase.TRANSFER, FootPhase.LANDING, FootPhase.DONE]
    assert robot.phases == wanted
    assert robot.stance.T_world_free(robot.q).translation == pytest.approx([0.4, 0, 0.005], abs=1e-8)
    last = robot.statuses[-1]
    assert (last.progress, last.foot, last.text) == (1.0, Foot.B, "")
    assert last.T_world_goal[:3] == pytest.approx([0.4, 0, 0.005], abs=1e-8)
    assert last.duration_s > 0.5
    assert 0 < last.margin < 1
    assert [status.seq for status in robot.statuses] == list(range(len(robot.statuses)))
    shares = [status.progress for status in robot.statuses]
    assert shares == sorted(shares)


def test_targets_come_at_their_rate_and_never_too_fast(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.run()
    stamps_ns = np.array([stamp_ns for stamp_ns, _ in robot.targets])
    assert (np.diff(stamps_ns) == 50_000_000).all()
    q = np.array([ZERO, *(target.q for _, target in robot.targets)])
    durations_s = np.array([target.duration_s for _, target in robot.targets])
    assert durations_s[:-1] == pytest.approx(0.05)
    assert (np.abs(np.diff(q, axis=0)) <= 0.5 * CLIMBER.max_velocity * durations_s[:, None] + 1e-9).all()
    assert robot.statuses[-1].duration_s == pytest.approx(durations_s.sum())


def test_targets_keep_their_rate_though_states_come_at_other_times(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.run(step_ns=15_000_000)
    stamps_ns = np.array([stamp_ns for stamp_ns, _ in robot.targets])
    assert abs(stamps_ns[-1] - stamps_ns[0] - 50_000_000 * (len(stamps_ns) - 1)) < 15_000_000


def test_a_pause_of_time_pauses_the_step_and_late_states_leave_nothing_out(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.tick(20)
    num_sent = len(robot.targets)
    robot.tick(50, step_ns=0)
    assert len(robot.targets) <= num_sent + 1
    slow = Robot(StepPlanner(PlannerConfig(), CLIMBER, seed=1))
    slow.take(slow.planner.add_foot_target(NEXT))
    slow.run(step_ns=300_000_000)
    robot.run()
    np.testing.assert_array_equal([t.q for _, t in slow.targets], [t.q for _, t in robot.targets])


def test_the_status_comes_twice_a_second_and_with_each_phase(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.run()
    stamps_s = np.array([status.stamp_ns for status in robot.statuses]) / 1e9
    assert np.diff(stamps_s).max() <= 0.56
    assert len(robot.statuses) < 2 * stamps_s[-1] + 8


def test_a_step_of_the_fixed_foot_changes_feet_first(robot):
    robot.take(robot.planner.add_foot_target(at((-0.15, 0, 0), UP, foot=Foot.A)))
    robot.run()
    assert robot.leg_targets == [Foot.B]
    assert robot.phases[-1] is FootPhase.DONE
    assert robot.stance.fixed_foot is Foot.B
    assert robot.stance.T_world_free(robot.q).translation == pytest.approx([-0.15, 0, 0.005], abs=1e-8)


def test_the_fixed_foot_cannot_step_when_the_other_stands_on_nothing():
    short = Climber.of(MODEL, structure(BEAM))
    robot = Robot(StepPlanner(PlannerConfig(), short, seed=1))
    robot.q = np.array([0, 0, 0.3, 0, 0, 0, 0, 0.0])
    robot.tick()
    with pytest.raises(RefusedError, match="foot A is fixed, and foot B cannot take over: the nearest steel is"):
        robot.planner.add_foot_target(at((-0.15, 0, 0), UP, foot=Foot.A))


def test_a_refusal_is_also_told_as_a_status(robot):
    with pytest.raises(RefusedError, match="no flush steel there"):
        robot.planner.add_foot_target(at((0.4, 0, 0.5), UP))
    robot.tick(3)
    assert robot.phases == [FootPhase.REFUSED]
    assert robot.statuses[-1].text.startswith("no flush steel there")
    assert robot.targets == []
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.run()
    assert robot.phases[-1] is FootPhase.DONE


def test_one_step_at_a_time_and_none_without_a_robot(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    with pytest.raises(RefusedError, match="a step of foot B is under way"):
        robot.planner.add_foot_target(NEXT)
    with pytest.raises(RefusedError, match="no state of the robot"):
        StepPlanner(PlannerConfig(), CLIMBER, seed=1).add_foot_target(NEXT)


def event(source="sim", severity=Severity.WARNING, key=JOINTS_TARGET.key_expr):
    return Event(stamp_ns=0, seq=0, frame="", source=source, severity=severity, text="q1 is too big", refused_key=key)


def test_a_refusal_by_the_simulation_ends_the_step(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.tick(10)
    assert robot.planner.add_event(event(source="player")) == []
    assert robot.planner.add_event(event(key="")) == []
    assert robot.planner.add_event(event(key=SIM_CONTROL.key_expr)) == []
    robot.take(robot.planner.add_event(event()))
    assert (robot.statuses[-1].phase, robot.statuses[-1].text) == (FootPhase.FAILED, "q1 is too big")
    num_sent = len(robot.targets)
    robot.tick(50)
    assert len(robot.targets) == num_sent
    assert robot.planner.add_event(event()) == []


def test_a_fall_ends_the_step(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.take(robot.planner.add_event(event(severity=Severity.ERROR, key="")))
    assert robot.statuses[-1].phase is FootPhase.FAILED


def test_someone_elses_change_of_foot_and_a_reset_stop_the_step(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.tick(10)
    robot.stance = robot.stance.changed(robot.q)
    robot.take(robot.planner.add_leg_state(robot.leg_state()))
    assert (robot.statuses[-1].phase, robot.statuses[-1].text) == (FootPhase.STOPPED, "someone fixed foot B")
    robot = Robot(StepPlanner(PlannerConfig(), CLIMBER, seed=1))
    robot.tick(5)
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.tick(10)
    robot.stamp_ns = 0
    robot.tick()
    assert (robot.statuses[-1].phase, robot.statuses[-1].text) == (FootPhase.STOPPED, "simulated time was set back")


def test_joints_that_do_not_arrive_fail_the_step_with_name_and_values(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.tick(20)
    q = robot.q
    for _ in range(5000):
        robot.q = q
        robot.tick()
        if not robot.planner.is_busy:
            break
    assert robot.statuses[-1].phase is FootPhase.FAILED
    assert "instead of" in robot.statuses[-1].text
    assert robot.statuses[-1].text.endswith("within 10 s")


def test_encoders_that_err_keep_feet_neither_from_changing_nor_lifting_nor_arriving():
    rng = np.random.default_rng(3)
    robot = Robot(StepPlanner(PlannerConfig(), CLIMBER, seed=1))
    robot.error = lambda: 0.002 * rng.standard_normal(8)
    robot.tick()
    for target in (NEXT, at((-0.05, 0, 0), UP, foot=Foot.A), at((0.5, 0, 0), UP, foot=Foot.B)):
        robot.take(robot.planner.add_foot_target(target))
        robot.run()
        assert robot.statuses[-1].phase is FootPhase.DONE


def three_lines(ramp_s):
    q = np.zeros((4, 8))
    q[1:, 0], q[2:, 6], q[3, 1] = 0.2, 0.02, 0.01
    plan = StepPlan(Stance(Foot.A, SE3.identity()), SE3.identity(), q[:2], q[1:3], q[2:], 1.0)
    return q, Schedule(plan, np.array([1, 0.05, 1, 1, 1, 1, 0.05, 1]), 0.5, ramp_s)


def test_the_slowest_joint_sets_the_pace():
    q, schedule = three_lines(0.0)
    assert schedule.duration_s == pytest.approx(0.4 + 0.8 + 0.4)
    assert schedule.q_at(0.2) == pytest.approx(0.5 * q[1])
    assert schedule.q_at(0.8)[6] == pytest.approx(0.01)
    assert schedule.q_at(9.0) == pytest.approx(q[3])
    assert schedule.q_end == pytest.approx(q[3])
    phases = [schedule.phase_at(t) for t in (0.0, 0.4, 0.5, 1.3, 9.0)]
    assert phases == [FootPhase.LIFT, FootPhase.LIFT, FootPhase.TRANSFER, FootPhase.LANDING, FootPhase.LANDING]


def test_each_phase_starts_and_ends_at_rest():
    q, schedule = three_lines(0.2)
    assert schedule.duration_s == pytest.approx(0.6 + 1.0 + 0.6)
    times_s = np.linspace(0, schedule.duration_s, 2201)
    path = np.array([schedule.q_at(t) for t in times_s])
    speed = np.abs(np.diff(path, axis=0)).max(axis=1) / np.diff(times_s)
    assert speed[[0, 599, 600, 1599, 1600, -1]] == pytest.approx(0, abs=0.003)
    assert speed.max() <= 0.5 + 1e-9
    assert schedule.q_at(0.1)[0] == pytest.approx(0.2 * 0.1**2 / (2 * 0.2 * 0.4))
    assert schedule.q_at(0.5)[0] == pytest.approx(0.2 - 0.2 * 0.1**2 / (2 * 0.2 * 0.4))
    assert schedule.q_at(0.6) == pytest.approx(q[1])
    assert schedule.q_at(1.6) == pytest.approx(q[2])


def test_a_stop_ends_the_step_where_it_is(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.tick(30)
    robot.take(robot.planner.stop(Stop(text="someone is near")))
    num_targets = len(robot.targets)
    robot.tick(100)
    assert (robot.statuses[-1].phase, robot.statuses[-1].text) == (FootPhase.STOPPED, "stopped: someone is near")
    assert len(robot.targets) == num_targets
    assert robot.planner.stop(Stop()) == [], "nothing is under way"
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.run()
    assert robot.phases[-1] is FootPhase.DONE


# ---- deaths


def test_a_foot_that_nobody_fixed_is_asked_for_again(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.run()
    robot.leg_targets.clear()
    target = at((0.1, 0, 0), UP)
    said = []
    planner = robot.planner
    planner.add_foot_target(FootTarget(foot=Foot.A, point_m=target.point_m, normal=target.normal))
    for _ in range(250):
        state = JointState(stamp_ns=robot.stamp_ns, seq=0, frame="", q=robot.q, dq=ZERO)
        said += [message for message in planner.add_joint_state(state) if isinstance(message, LegTarget)]
        robot.stamp_ns += 10_000_000
    assert said == [LegTarget(foot=Foot.B)] * 3


def test_a_planner_that_was_killed_says_that_its_step_has_ended(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.tick(50)
    state = decode(PlannerState, encode(robot.planner.snapshot()))
    again = StepPlanner(PlannerConfig(), CLIMBER, seed=1)
    (status,) = again.restore(state)
    assert (status.foot, status.phase, status.seq) == (Foot.B, FootPhase.STOPPED, robot.statuses[-1].seq + 1)
    assert "started again" in status.text
    assert 0 < status.progress < 1
    assert status.stamp_ns == robot.stamp_ns - 10_000_000
    assert not again.is_busy


def test_a_planner_that_had_nothing_to_do_says_nothing(robot):
    assert StepPlanner(PlannerConfig(), CLIMBER, seed=1).restore(robot.planner.snapshot()) == []


def test_a_step_goes_on_when_the_simulation_was_away(robot):
    robot.take(robot.planner.add_foot_target(NEXT))
    robot.tick(50)
    robot.stamp_ns += 10_000_000_000
    robot.run()
    assert robot.statuses[-1].phase is FootPhase.DONE
