import numpy as np
import pytest

from services.player.player import Player
from services.player.trajectory import ChangeFoot, MoveTo
from shared.errors import PlaybackError, StoppedError
from shared.messaging.messages import Event, Foot, JointState, JointTarget, LegState, LegTarget, Severity, Stop
from shared.runtime.config import PlayerConfig
from tests.support.robots import last, run, running

CONFIG = PlayerConfig(num_steps=4, speed_radps=None, rate_hz=10.0, timeout_s=1.0)
MOVE = MoveTo(np.full(8, 0.4), line=2)
PERIOD_NS = 100_000_000


class Robot:
    """Tells a player where the joints are, one period of the player's later each time."""

    def __init__(self, *moves, config=CONFIG):
        self.player = Player(config, moves)
        self.num_periods = 0

    def is_at(self, value):
        stamp_ns = self.num_periods * PERIOD_NS
        self.num_periods += 1
        q = np.full(8, value)
        return self.player.add_joint_state(JointState(stamp_ns=stamp_ns, seq=0, frame="foot_a", q=q, dq=np.zeros(8)))

    def stands_on(self, foot):
        pose = np.array([0, 0, 0, 0, 0, 0, 1])
        state = LegState(stamp_ns=0, seq=0, frame="world", fixed_foot=foot, T_world_foot=pose)
        assert self.player.add_leg_state(state) == []


def standing_robot(*moves, config=CONFIG):
    robot = Robot(*moves, config=config)
    robot.stands_on(Foot.A)
    return robot


def wait_long(robot):
    for _ in range(20):
        robot.is_at(0.0)


def test_says_nothing_before_the_fixed_foot_is_known():
    assert Robot(MOVE).is_at(0.0) == []


def test_steps_are_equal_and_end_at_the_target():
    robot = standing_robot(MOVE)
    commands = [command for _ in range(4) for command in robot.is_at(0.0)]
    assert all(isinstance(command, JointTarget) and command.duration_s == 0.1 for command in commands)
    np.testing.assert_allclose([command.q[0] for command in commands], [0.1, 0.2, 0.3, 0.4])


def test_with_a_speed_the_longest_way_decides_how_long_a_row_takes():
    config = CONFIG.model_copy(update={"speed_radps": 0.5, "ramp_s": 0.4})
    robot = standing_robot(MoveTo(np.array([0.4, 0.1, 0, 0, 0, 0, 0, 0]), line=2), config=config)
    commands = [command for _ in range(30) for command in robot.is_at(0.0)]
    assert len(commands) == 24  # 0.1 m count as 1 rad, which takes 2 s, and a ramp
    pistons = np.array([0.0, *(command.q[1] for command in commands)])
    np.testing.assert_allclose(np.diff(pistons)[4:-4], 0.005)
    np.testing.assert_allclose(np.diff(pistons)[:4], np.array([1, 3, 5, 7]) / 8 * 0.005)
    np.testing.assert_allclose(np.diff(pistons)[-4:], np.array([7, 5, 3, 1]) / 8 * 0.005)
    assert pistons[-1] == 0.1


def test_between_its_periods_and_while_time_stands_still_nothing_is_said():
    robot = standing_robot(MOVE)
    assert len(robot.is_at(0.0)) == 1
    same = JointState(stamp_ns=PERIOD_NS // 2, seq=0, frame="foot_a", q=np.zeros(8), dq=np.zeros(8))
    assert [robot.player.add_joint_state(same) for _ in range(50)] == [[]] * 50


def test_waits_until_the_robot_has_arrived():
    robot = standing_robot(MOVE)
    for _ in range(6):
        robot.is_at(0.0)
    assert not robot.player.is_done
    assert robot.is_at(0.3995) == []
    assert robot.player.is_done
    assert robot.player.progress == 1.0


def test_the_next_move_begins_where_the_last_one_ended():
    robot = standing_robot(MOVE, MoveTo(np.zeros(8), line=3))
    for _ in range(4):
        robot.is_at(0.0)
    assert robot.is_at(0.4) == [], "the last command takes a period"
    (command,) = robot.is_at(0.4)
    assert command.q[0] == pytest.approx(0.3)


def test_a_foot_change_is_said_once_and_awaited():
    robot = standing_robot(ChangeFoot(line=2))
    assert robot.is_at(0.0) == [LegTarget(foot=Foot.B)]
    assert robot.is_at(0.0) == []
    robot.stands_on(Foot.B)
    assert robot.is_at(0.0) == []
    assert robot.player.is_done


def test_gives_up_with_the_joint_that_does_not_arrive():
    robot = standing_robot(MOVE)
    with pytest.raises(PlaybackError, match=r"line 2: waited 1 s for q1 to go from 0.0000 to 0.4000"):
        wait_long(robot)


def test_gives_up_on_a_foot_that_does_not_change():
    robot = standing_robot(ChangeFoot(line=7))
    with pytest.raises(PlaybackError, match=r"line 7: waited 1 s for foot B"):
        wait_long(robot)


def test_goes_on_after_the_simulation_was_started_again():
    robot = standing_robot(MOVE)
    robot.num_periods = 1000
    assert len(robot.is_at(0.0)) == 1
    robot.num_periods = 0
    assert len(robot.is_at(0.0)) == 1


def event(source, severity, text, refused_key=""):
    return Event(stamp_ns=0, seq=0, frame="", source=source, severity=severity, text=text, refused_key=refused_key)


def test_a_refusal_or_a_fall_ends_it_and_nothing_else():
    player = standing_robot(MOVE).player
    with pytest.raises(PlaybackError, match="line 2: q1 is 9"):
        player.add_event(event("sim", Severity.WARNING, "q1 is 9", "hyrecro/joints/target"))
    with pytest.raises(PlaybackError, match="line 2: it falls"):
        player.add_event(event("sim", Severity.ERROR, "it falls"))
    assert player.add_event(event("sim", Severity.WARNING, "a1_l is beyond its stroke")) == []
    assert player.add_event(event("mapper", Severity.ERROR, "lost")) == []


def test_a_stop_ends_the_trajectory_and_names_the_line():
    robot = standing_robot(MOVE)
    robot.is_at(0.0)
    with pytest.raises(StoppedError, match="line 2: stopped: someone is near"):
        robot.player.stop(Stop(text="someone is near"))


def test_a_stop_after_the_last_row_is_nobodys_business():
    robot = standing_robot()
    assert robot.player.stop(Stop()) == []


# ---- a robot, or a bus, that was away


def test_what_nobody_heard_is_sent_again():
    robot = standing_robot(MOVE)
    for _ in range(4):
        robot.is_at(0.0)
    said = [command for _ in range(10) for command in robot.is_at(0.0)]  # a second of waiting
    (again,) = said
    np.testing.assert_allclose(again.q, MOVE.q)
    assert again.duration_s == 0.1


def test_a_foot_is_asked_for_again():
    config = CONFIG.model_copy(update={"timeout_s": 30.0})
    robot = standing_robot(ChangeFoot(line=2), config=config)
    said = [command for _ in range(35) for command in robot.is_at(0.0)]
    assert said == [LegTarget(foot=Foot.B)] * 4
    robot.stands_on(Foot.B)
    robot.is_at(0.0)
    assert robot.player.is_done


def test_it_goes_on_where_it_was_when_the_simulation_was_away_and_halted():
    robot = standing_robot(MOVE)
    first = [command for _ in range(2) for command in robot.is_at(0.0)]
    robot.num_periods += 300  # nothing was heard for half a minute, or simulated time jumped
    restored = Event(stamp_ns=0, seq=0, frame="", source="sim", severity=Severity.WARNING, text="restored at 3 s")
    assert robot.player.add_event(restored) == []
    dead = Event(stamp_ns=0, seq=0, frame="", source="supervisor", severity=Severity.ERROR, text="sim was killed")
    assert robot.player.add_event(dead) == []
    rest = [command for _ in range(2) for command in robot.is_at(0.15)]
    np.testing.assert_allclose([command.q[0] for command in [*first, *rest]], [0.1, 0.2, 0.3, 0.4])


def test_a_robot_whose_player_vanished_stands_within_a_period():
    with running() as sim:
        player = Player(CONFIG, (MoveTo(np.full(8, 0.02), line=2),))
        messages = sim.start()
        for _ in range(15):
            for message in messages:
                if isinstance(message, LegState):
                    player.add_leg_state(message)
                for command in player.add_joint_state(message) if isinstance(message, JointState) else ():
                    sim.set_joint_target(command)
            messages = sim.step()
        moving = last(JointState, run(sim, 0.01))
        assert np.abs(moving.dq).max() > 0.02
        still = last(JointState, run(sim, 0.1))
        assert np.abs(still.dq).max() == 0.0
        assert np.array_equal(last(JointState, run(sim, 5.0)).q, still.q)
