import numpy as np
import pytest

from services.player.player import Player
from services.player.trajectory import ChangeFoot, MoveTo
from shared.errors import PlaybackError
from shared.messaging.messages import Event, Foot, JointState, JointTarget, LegState, LegTarget, Severity
from shared.runtime.config import PlayerConfig

CONFIG = PlayerConfig(num_steps=4, rate_hz=10.0, timeout_s=1.0)
MOVE = MoveTo(np.full(8, 0.4), line=2)


def joints(value):
    return JointState(stamp_ns=0, seq=0, frame="foot_a", q=np.full(8, value), dq=np.zeros(8))


def leg(foot):
    pose = [0, 0, 0, 0, 0, 0, 1]
    return LegState(stamp_ns=0, seq=0, frame="world", fixed_foot=foot, T_world_foot=np.array(pose))


def ready_player(*moves):
    player = Player(CONFIG, moves)
    player.add_joint_state(joints(0.0))
    player.add_leg_state(leg(Foot.A))
    return player


def wait_long(player):
    for _ in range(20):
        player.tick()


def test_says_nothing_before_the_state_is_known():
    assert Player(CONFIG, (MOVE,)).tick() == []


def test_steps_are_equal_and_end_at_the_target():
    player = ready_player(MOVE)
    commands = [command for _ in range(4) for command in player.tick()]
    assert all(isinstance(command, JointTarget) and command.duration_s == 0.1 for command in commands)
    np.testing.assert_allclose([command.q[0] for command in commands], [0.1, 0.2, 0.3, 0.4])


def test_waits_until_the_robot_has_arrived():
    player = ready_player(MOVE)
    for _ in range(6):
        player.tick()
    assert not player.is_done
    player.add_joint_state(joints(0.3995))
    assert player.tick() == []
    assert player.is_done
    assert player.progress == 1.0


def test_the_next_move_begins_in_the_tick_of_arrival():
    player = ready_player(MOVE, MoveTo(np.zeros(8), line=3))
    for _ in range(4):
        player.tick()
    player.add_joint_state(joints(0.4))
    (command,) = player.tick()
    assert command.q[0] == pytest.approx(0.3)


def test_a_foot_change_is_said_once_and_awaited():
    player = ready_player(ChangeFoot(line=2))
    assert player.tick() == [LegTarget(foot=Foot.B)]
    assert player.tick() == []
    player.add_leg_state(leg(Foot.B))
    assert player.tick() == []
    assert player.is_done


def test_gives_up_with_the_joint_that_does_not_arrive():
    player = ready_player(MOVE)
    with pytest.raises(PlaybackError, match=r"line 2: waited 1 s for q1 to go from 0.0000 to 0.4000"):
        wait_long(player)


def test_gives_up_on_a_foot_that_does_not_change():
    player = ready_player(ChangeFoot(line=7))
    with pytest.raises(PlaybackError, match=r"line 7: waited 1 s for foot B"):
        wait_long(player)


def test_a_refusal_by_the_simulation_ends_it():
    player = ready_player(MOVE)
    refusal = Event(stamp_ns=0, seq=0, frame="", source="sim", severity=Severity.WARNING, text="q1 is 9")
    with pytest.raises(PlaybackError, match="line 2: q1 is 9"):
        player.add_event(refusal)
    other = Event(stamp_ns=0, seq=0, frame="", source="mapper", severity=Severity.WARNING, text="lost")
    assert player.add_event(other) == []
