"""`hyrecro simulate`: a climb and its scans as files, without any bus and as fast as the machine can."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray
from rich.progress import Progress

from cli.offline import climb_messages
from services.player.player import Player
from services.player.trajectory import read_trajectory
from services.sensors.loading import load_lidar, sensor_seed
from shared.cloud_files import write_scan
from shared.errors import InputFileError
from shared.messaging.frames import FrameTree
from shared.messaging.messages import (
    JOINT_NAMES,
    JointState,
    LegState,
    Message,
    RobotDescription,
    StructureDescription,
    Transforms,
)
from shared.runtime.config import Config
from shared.runtime.sensor_config import LidarConfig
from shared.trajectory_files import write_tum

Ints = NDArray[np.int32]

_FACES = {
    "box": ["-x", "+x", "-y", "+y", "-z", "+z"],
    "cylinder": ["side", "bottom", "top"],
    "sphere": ["surface"],
    "mesh": "triangles in one plane share a number",
}


@dataclass(slots=True)
class Climb:
    """What was said on the way: the descriptions; joints, fixed foot and transforms of each step."""

    descriptions: dict[type[Message], Message] = field(default_factory=dict)
    joints: list[JointState] = field(default_factory=list)
    feet: list[str] = field(default_factory=list)
    transforms: list[Transforms] = field(default_factory=list)


def simulate(config: Config, out: Path, num_scans: int | None, progress: Progress) -> int:
    """Writes data0.pcd, labels0.npy, ranges0.npy ..., labels.json, truth.tum and joints.csv; returns how many scans.

    Labels and ranges are the truth of each point: member and face, and metres along its beam.

    num_scans: evenly over the climb, its first and last moment among them; None = at the LiDAR's own rate.

    Raises:
        InputFileError: the folder has files already. HyrecroError: the climb cannot be carried out.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputFileError(f"{out}: must be a folder that is empty or does not exist yet")
    climb = _climb(config, progress)
    out.mkdir(parents=True, exist_ok=True)
    _write_joints(out / "joints.csv", climb)
    rows = _rows_to_scan(climb.transforms, num_scans, config)
    to_scan = [climb.transforms[row] for row in rows]
    frame = config.sensors.lidar.frame
    write_tum(out / "truth.tum", [(each.stamp_ns, FrameTree(each).T_root(frame)) for each in to_scan])
    lidar = config.sensors.lidar.model_copy(update={"truth": True})
    scanner = load_lidar(lidar, sensor_seed(config.seed, "lidar"))
    scanner.set_robot(cast(RobotDescription, climb.descriptions[RobotDescription]))
    scanner.set_structure(cast(StructureDescription, climb.descriptions[StructureDescription]))
    for i, row in enumerate(progress.track(rows, description="scan")):
        scan = scanner.scan(_of_one_scan(climb.transforms, row, lidar))
        write_scan(out / f"data{i}.pcd", scan)
        np.save(out / f"labels{i}.npy", np.column_stack([cast(Ints, scan.member), cast(Ints, scan.face)]))
        np.save(out / f"ranges{i}.npy", cast(NDArray[np.float32], scan.true_range_m))
    names = {"columns": ["member", "face"], "members": scanner.member_names, "faces": _FACES}
    (out / "labels.json").write_text(json.dumps(names, indent=1) + "\n")
    return len(to_scan)


def _climb(config: Config, progress: Progress) -> Climb:
    player = Player(config.player, read_trajectory(config.player.trajectory))
    task = progress.add_task("climb", total=1.0)
    climb, foot = Climb(), ""
    for message in climb_messages(config, player):
        match message:
            case LegState():
                foot = message.fixed_foot.value
            case JointState():
                climb.joints.append(message)
                climb.feet.append(foot)
                progress.update(task, completed=player.progress)
            case Transforms():
                climb.transforms.append(message)
            case RobotDescription() | StructureDescription():
                climb.descriptions[type(message)] = message
    climb.feet[0] = climb.feet[1]  # the first joints are told before the first foot
    return climb


def _rows_to_scan(transforms: Sequence[Transforms], num_scans: int | None, config: Config) -> list[int]:
    if num_scans is not None:
        rows = np.linspace(0, len(transforms) - 1, num_scans).round().astype(int)
        return [int(row) for row in np.unique(rows)]
    periods = [each.stamp_ns * config.sensors.lidar.rate_hz // 1e9 for each in transforms]
    return [row for row, period in enumerate(periods) if row == 0 or period != periods[row - 1]]


def _of_one_scan(transforms: Sequence[Transforms], row: int, lidar: LidarConfig) -> Sequence[Transforms]:
    """Those from this row on that a scan needs: with a rolling shutter all until the revolution is over."""
    if not lidar.rolling_shutter:
        return transforms[row : row + 1]
    end_ns = transforms[row].stamp_ns + 1e9 / lidar.rate_hz
    later = (i for i in range(row, len(transforms)) if transforms[i].stamp_ns >= end_ns)
    return transforms[row : next(later, len(transforms)) + 1]


def _write_joints(path: Path, climb: Climb) -> None:
    """A row a step: time in seconds, measured positions in radians and metres, the fixed foot."""
    with path.open("w", encoding="ascii") as file:
        file.write("t," + ",".join(JOINT_NAMES) + ",fixed_foot\n")
        for joints, foot in zip(climb.joints, climb.feet, strict=True):
            values = ",".join(repr(float(value)) for value in joints.q)
            file.write(f"{joints.stamp_ns // 10**9}.{joints.stamp_ns % 10**9:09d},{values},{foot}\n")
