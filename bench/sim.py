"""How fast the simulation is, and how a step's cost grows with the structure.

`python -m bench.sim` runs each figure several times and prints medians. The peer is pybullet as it is commonly used for
such a world, and as Gazebo does it with its engines: one body for each bar. Same robot, bars, step length and number of
solver iterations, one thread each, in the same run.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from services.sim.climbing_sim import ClimbingSim
from services.sim.physics import Physics
from services.sim.quiet_pybullet import pybullet
from shared.geometry import SE3
from shared.messaging.messages import Foot, JointTarget
from shared.robot.urdf import parse_urdf, read_urdf
from shared.runtime.config import CONFIGS_DIR, DynamicsConfig, SimConfig
from shared.solids import Box
from shared.world.files import load_structure
from shared.world.structure import Member, Structure

_URDF = read_urdf(CONFIGS_DIR / "robot" / "hyrecro.urdf")
_MARK = read_urdf(CONFIGS_DIR / "robot" / "fixed_foot.urdf")
_IN_THE_AIR_M = (0.0, -0.775, 10.3)
"""The foot is held where the robot touches nothing, for the peer too."""
_Q = np.array([0.3, 0.01, 0.2, 0.4, 0.6, 0.4, -0.01, 0.2])


@dataclass(frozen=True, slots=True)
class Figures:
    """Of one structure: kinematic steps a second, dynamic real-time factor, and microseconds of one engine step."""

    num_bars: int
    kinematic_steps_per_s: float
    dynamic_real_time_factor: float
    engine_step_us: float
    peer_step_us: float

    @property
    def ratio(self) -> float:
        """How many times quicker than the peer an engine step is."""
        return self.peer_step_us / self.engine_step_us


def measure(num_bars: int, num_runs: int, seconds: float) -> Figures:
    """Medians of `num_runs` runs, each over so many seconds of simulated time."""
    structure = lattice(num_bars)
    config = DynamicsConfig()

    def median(run: Callable[[], float]) -> float:
        return statistics.median(run() for _ in range(num_runs))

    return Figures(
        num_bars=len(structure.members),
        kinematic_steps_per_s=1 / median(lambda: _facade_step_s(SimConfig(), structure, seconds)),
        dynamic_real_time_factor=0.01 / median(lambda: _facade_step_s(SimConfig(mode="dynamic"), structure, seconds)),
        engine_step_us=1e6 * median(lambda: _engine_step_s(structure, config, seconds)),
        peer_step_us=1e6 * median(lambda: _peer_step_s(structure, config, seconds)),
    )


def lattice(num_bars: int) -> Structure:
    """The original's 21 bars, and as many more in a grid around it as are asked for."""
    original = load_structure(CONFIGS_DIR / "structures" / "original.yaml")
    places = [(x, y, z) for z in range(40) for y in range(-8, 8) for x in range(-8, 8)]
    more = [
        Member(f"post_{i}", Box((0.2, 0.2, 2.0)), SE3.trans(6 + 2.0 * x, 40 + 2.0 * y, 2.0 * z))
        for i, (x, y, z) in enumerate(places[: num_bars - len(original.members)])
    ]
    return Structure("lattice", (*original.members, *more), 0.0)


def _facade_step_s(config: SimConfig, structure: Structure, seconds: float) -> float:
    sim = ClimbingSim(config, _URDF, structure, _MARK)
    sim.start()
    sim.set_joint_target(JointTarget(q=_Q, duration_s=seconds))
    num_steps = round(seconds * config.rate_hz)
    started = time.perf_counter()
    for _ in range(num_steps):
        sim.step()
    elapsed = time.perf_counter() - started
    sim.close()
    return elapsed / num_steps


def _engine_step_s(structure: Structure, config: DynamicsConfig, seconds: float) -> float:
    physics = Physics(_URDF, parse_urdf(_URDF, "hyrecro.urdf"), structure, config, 1 / config.step_hz)
    T_world_foot = SE3.from_rpy((0, 0, np.pi / 2), _IN_THE_AIR_M)
    physics.place(Foot.A, T_world_foot)
    physics.hold(Foot.A, T_world_foot)
    return _timed_steps(physics, config, seconds)


def _peer_step_s(structure: Structure, config: DynamicsConfig, seconds: float) -> float:
    physics = Physics(
        _URDF,
        parse_urdf(_URDF, "hyrecro.urdf"),
        Structure("none", (), structure.ground_z_m),
        config,
        1 / config.step_hz,
    )
    client = physics.engine.client
    for member in structure.members:
        assert isinstance(member.solid, Box)
        half = [length / 2 for length in member.solid.size_m]
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, **client)
        pose = member.T_world_member.xyz_quat_xyzw.tolist()
        pybullet.createMultiBody(0, shape, basePosition=pose[:3], baseOrientation=pose[3:], **client)
    T_world_foot = SE3.from_rpy((0, 0, np.pi / 2), _IN_THE_AIR_M)
    physics.place(Foot.A, T_world_foot)
    physics.hold(Foot.A, T_world_foot)
    return _timed_steps(physics, config, seconds)


def _timed_steps(physics: Physics, config: DynamicsConfig, seconds: float) -> float:
    num_steps = round(seconds * config.step_hz)
    physics.drive(0 * _Q, 0 * _Q)
    started = time.perf_counter()
    for _ in range(num_steps):
        physics.step()
    elapsed = time.perf_counter() - started
    physics.engine.close()
    return elapsed / num_steps


def main() -> None:
    """Measures and prints a table, or JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.sim", description=__doc__)
    parser.add_argument("--bars", type=int, nargs="+", default=[21, 200, 2000])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="of simulated time, each run")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = [measure(num_bars, arguments.runs, arguments.seconds) for num_bars in arguments.bars]
    if arguments.json:
        print(json.dumps([{**asdict(row), "ratio": row.ratio} for row in rows], indent=1))
        return
    table = Table("bars", "kinematic steps/s", "dynamic real-time factor", "engine step us", "a body a bar us", "ratio")
    for row in rows:
        table.add_row(
            str(row.num_bars),
            f"{row.kinematic_steps_per_s:.0f}",
            f"{row.dynamic_real_time_factor:.1f}",
            f"{row.engine_step_us:.0f}",
            f"{row.peer_step_us:.0f}",
            f"{row.ratio:.1f}",
        )
    Console().print(table)


if __name__ == "__main__":
    main()
