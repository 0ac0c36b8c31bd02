"""What another robot in view does to a robot's map: the shipped climb with and without one that walks beside it.

`python -m bench.two_robots` needs no bus: simulations, LiDAR and mapper are stepped in turn. It prints, for both cases,
the trajectory's error against the truth, the share of the scans' points that lie on the other robot, and how many of
the map's points lie off all steel.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.mapper.mapper import Mapper
from services.player.trajectory import MoveTo, read_trajectory
from services.sensors.loading import load_lidar, sensor_seed
from services.sensors.surroundings import MEMBERS_A_ROBOT
from services.sim.node import load_sim
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import (
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    Message,
    Odometry,
    RobotDescription,
    StructureDescription,
    Transforms,
)
from shared.runtime.config import CONFIGS_DIR, Config
from shared.runtime.config_loading import load_config
from shared.solids import Box
from shared.world.files import load_structure

OFF_STEEL_M = 0.05
MOVE_S = 2.5
"""Each row of a trajectory takes so long."""


class Walker:
    """A simulated robot that goes through a trajectory, again and again if `is_endless`."""

    def __init__(self, config: Config, trajectory: Path, *, is_endless: bool) -> None:
        self._sim = load_sim(config)
        self._rows = read_trajectory(trajectory)
        self._is_endless = is_endless
        self._state: dict[type[Message], Any] = {}

    def messages(self) -> Iterator[list[Message]]:
        """What the simulation says, step by step, until the trajectory ends."""
        yield self._noted(self._sim.start())
        while True:
            for row in self._rows:
                yield from self._row(row)
            if not self._is_endless:
                return
            self._rows = self._rows[::-1]  # the way back

    def _row(self, row: object) -> Iterator[list[Message]]:
        if not isinstance(row, MoveTo):
            leg: LegState = self._state[LegState]
            yield self._noted(self._sim.set_fixed_foot(LegTarget(foot=leg.fixed_foot.other)))
            return
        yield self._noted(self._sim.set_joint_target(JointTarget(q=row.q, duration_s=MOVE_S)))
        while not np.array_equal(self._state[JointState].q, row.q):
            yield self._noted(self._sim.step())

    def _noted(self, messages: list[Message]) -> list[Message]:
        self._state |= {type(message): message for message in messages}
        return messages


def climb(trajectories: tuple[Path, Path], *, with_other: bool) -> dict[str, Any]:
    """Maps the first robot's climb; the other robot is there or not, the rest is the same."""
    configs = [load_config(Path(name), ["sensors.lidar.truth=true"]) for name in ("robot_a", "robot_b")]
    lidar = load_lidar(configs[0].sensors.lidar, sensor_seed(1, "lidar"), other_robots=("robot_b",))
    mapper = Mapper(configs[0].mapper)
    other = Walker(configs[1], trajectories[1], is_endless=True).messages()
    errors: list[tuple[SE3, SE3]] = []
    shares: list[float] = []
    for messages in Walker(configs[0], trajectories[0], is_endless=False).messages():
        for message in next(other) if with_other else ():
            if isinstance(message, RobotDescription):
                lidar.set_other("robot_b", message)
            elif isinstance(message, Transforms):
                lidar.place_other("robot_b", message)
        for message in messages:
            for scan in _scans(lidar, mapper, message):
                assert scan.member is not None
                shares.append(float(np.mean(scan.member >= MEMBERS_A_ROBOT)))
                found = [said for said in mapper.add_scan(scan) if isinstance(said, Odometry)]
                T_world_lidar = FrameTree(message).T_root(scan.frame)  # type: ignore[arg-type]
                errors += [(T_world_lidar, SE3.from_xyz_quat_xyzw(said.T_frame_child)) for said in found]
    T_world_map = errors[0][0] @ errors[0][1].inv()
    off_m = np.array([np.linalg.norm(true.translation - (T_world_map @ map_).translation) for true, map_ in errors])
    points_m = T_world_map.apply(mapper.target.points_m)
    ghosts = _distances_m(points_m, configs[0]) > OFF_STEEL_M
    return {
        "scans": len(shares),
        "ate_rmse_mm": round(1e3 * float(np.sqrt(np.mean(off_m**2))), 2),
        "ate_max_mm": round(1e3 * float(off_m.max()), 2),
        "lost_scans": mapper.target.num_lost_scans,
        "scans_with_other": int(np.count_nonzero(shares)),
        "mean_share_percent": round(100 * float(np.mean(shares)), 2),
        "largest_share_percent": round(100 * float(np.max(shares)), 2),
        "map_points": len(points_m),
        "map_points_off_steel": int(ghosts.sum()),
        "planes": len(mapper.map_planes().planes),
    }


def _scans(lidar: Any, mapper: Mapper, message: Message) -> list[Any]:
    """Gives a message to whom it concerns; returns the scans that follow."""
    if isinstance(message, RobotDescription):
        mapper.set_robot(message)
        lidar.set_robot(message)
    elif isinstance(message, StructureDescription):
        lidar.set_structure(message)
    elif isinstance(message, JointState):
        mapper.add_joints(message)
    elif isinstance(message, LegState):
        mapper.add_leg_state(message)
    elif isinstance(message, Transforms):
        scans: list[Any] = lidar.add_transforms(message)
        return scans
    return []


def _distances_m(points_m: NDArray[np.floating], config: Config) -> NDArray[np.float64]:
    """Of points in the world (N, 3) to the nearest bar; the ground is far below."""
    nearest_m = np.full(len(points_m), np.inf)
    for member in load_structure(config.structure).members:
        assert isinstance(member.solid, Box)
        local_m = member.T_world_member.inv().apply(points_m)
        outside_m = np.abs(local_m) - np.array(member.solid.size_m) / 2
        nearest_m = np.minimum(nearest_m, np.linalg.norm(np.maximum(outside_m, 0.0), axis=1))
    return nearest_m


def main() -> None:
    """Prints both cases as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    folder = CONFIGS_DIR / "trajectories"
    parser.add_argument("--trajectory", type=Path, default=folder / "climb.csv")
    parser.add_argument("--other", type=Path, default=folder / "along_bar.csv")
    arguments = parser.parse_args()
    trajectories = (arguments.trajectory, arguments.other)
    cases = {"alone": climb(trajectories, with_other=False), "with_other": climb(trajectories, with_other=True)}
    print(json.dumps(cases, indent=1))


if __name__ == "__main__":
    main()
