"""A climb is played to its end although the simulation dies, and commands and states are lost, again and again."""

import numpy as np
import pytest

from services.player.player import Player
from services.player.trajectory import read_trajectory
from services.sim.climbing_sim import ClimbingSim
from services.sim.state import SimState
from shared.geometry import SE3
from shared.messaging.codec import decode, encode
from shared.messaging.messages import Event, JointState, JointTarget, LegState
from shared.runtime.config import CONFIGS_DIR, PlayerConfig, SimConfig
from tests.support.robots import MARK, NOTHING, URDF

MOVES = read_trajectory(CONFIGS_DIR / "trajectories" / "along_bar.csv")[:5]
CONFIG = PlayerConfig(num_steps=15, timeout_s=20.0)
MAX_STEPS = 20_000


class Climb:
    """The simulation and its player, without a bus. is_away(k): whether nothing is heard in step k, by either."""

    def __init__(self, is_away=lambda k: False):
        self.sim = ClimbingSim(SimConfig(), URDF, NOTHING, MARK)
        self.player = Player(CONFIG, MOVES)
        self.is_away = is_away
        self.leg = None
        self.num_steps = 0
        self.told = []
        self.tell(self.sim.start())

    def tell(self, messages):
        away = self.is_away(self.num_steps)
        for message in messages:
            if isinstance(message, LegState):
                self.leg = message
            if away:
                continue
            if isinstance(message, LegState):
                self.player.add_leg_state(message)
            elif isinstance(message, Event):
                self.player.add_event(message)
            elif isinstance(message, JointState):
                for command in self.player.add_joint_state(message):
                    self.obey(command)

    def obey(self, command):
        if isinstance(command, JointTarget):
            self.sim.set_joint_target(command)
        else:
            self.tell(self.sim.set_fixed_foot(command))

    def die_and_come_back(self):
        state = decode(SimState, encode(self.sim.snapshot()))
        self.sim.close()
        self.sim = ClimbingSim(SimConfig(), URDF, NOTHING, MARK, seed=77)
        restored = self.sim.restore(state)
        self.tell([*self.sim.start(), *restored])

    def run(self, dies=lambda k: False):
        while not self.player.is_done:
            self.num_steps += 1
            assert self.num_steps < MAX_STEPS
            if dies(self.num_steps):
                self.die_and_come_back()
            self.tell(self.sim.step())
        self.sim.close()
        return SE3.from_xyz_quat_xyzw(self.leg.T_world_foot)


@pytest.fixture(scope="module")
def undisturbed():
    return Climb().run()


def test_when_the_simulation_dies(undisturbed):
    """Every 1.4 s, at any moment of a row, also just before and after a change of foot."""
    T_world_foot = Climb().run(dies=lambda k: k % 137 == 0)
    np.testing.assert_allclose(T_world_foot.matrix, undisturbed.matrix, rtol=0, atol=1e-6)


def test_when_the_bus_is_away(undisturbed):
    """For up to a second at a time, a third of the time."""
    rng = np.random.default_rng(1)
    is_away = np.repeat(rng.random(MAX_STEPS) < 0.33, rng.integers(1, 100, MAX_STEPS))
    climb = Climb(lambda k: bool(is_away[k]))
    T_world_foot = climb.run(dies=lambda k: is_away[k] and k % 50 == 0)
    assert climb.num_steps > 300
    np.testing.assert_allclose(T_world_foot.matrix, undisturbed.matrix, rtol=0, atol=2e-3)
