"""Leg odometry of a simulated climb: `python -m bench.leg_prior DIR` reads joints.csv and truth.tum, writes prior.tum.

From truth.tum it takes the stamps of the scans alone. What the encoders say and which foot is fixed are all it knows.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared.geometry import SE3
from shared.messaging.messages import JOINT_NAMES, Foot
from shared.robot.kinematics import HYRECRO, T_fixed_free, T_footA_hip
from shared.robot.urdf import parse_urdf, read_urdf
from shared.runtime.config import CONFIGS_DIR
from shared.trajectory_files import read_tum, write_tum


@dataclass(frozen=True, slots=True)
class Posture:
    """What was measured at a time: q (8,) in radians, metres for q2 and q7."""

    stamp_ns: int
    q: NDArray[np.float64]
    fixed_foot: Foot


def leg_odometry(postures: Sequence[Posture], T_hip_lidar: SE3) -> Iterator[SE3]:
    """T_start_lidar of each posture; start is the plate of the foot that was fixed first. Feet that slide go unseen."""
    T_start_fixed, fixed = SE3.identity(), postures[0].fixed_foot
    for posture in postures:
        if posture.fixed_foot is not fixed:
            T_start_fixed, fixed = T_start_fixed @ T_fixed_free(posture.q, fixed), posture.fixed_foot
        T_fixed_footA = SE3.identity() if fixed is Foot.A else T_fixed_free(posture.q, Foot.B)
        yield T_start_fixed @ T_fixed_footA @ T_footA_hip(posture.q) @ T_hip_lidar


def read_postures(path: Path) -> list[Posture]:
    """The rows of a joints.csv as `hyrecro simulate` writes it."""
    rows = [line.split(",") for line in path.read_text(encoding="ascii").splitlines()[1:]]
    last = 1 + len(JOINT_NAMES)
    return [
        Posture(_stamp_ns(row[0]), np.array([float(value) for value in row[1:last]]), Foot(row[last])) for row in rows
    ]


def lidar_on_hip() -> SE3:
    """T_hip_lidar from the centre of the hip plate, by the robot's URDF."""
    joints = parse_urdf(read_urdf(CONFIGS_DIR / "robot" / "hyrecro.urdf"), "hyrecro.urdf").joints
    lidar = next(joint for joint in joints if joint.child == "lidar")
    return HYRECRO.T_hip_plate.inv() @ lidar.T_parent_joint


def main() -> None:
    """Writes DIR/prior.tum."""
    parser = argparse.ArgumentParser(prog="python -m bench.leg_prior", description=__doc__)
    parser.add_argument("directory", type=Path)
    directory = parser.parse_args().directory
    postures = read_postures(directory / "joints.csv")
    stamps_ns = {stamp_ns for stamp_ns, _ in read_tum(directory / "truth.tum")}
    poses = zip(postures, leg_odometry(postures, lidar_on_hip()), strict=True)
    write_tum(directory / "prior.tum", [(p.stamp_ns, T) for p, T in poses if p.stamp_ns in stamps_ns])


def _stamp_ns(text: str) -> int:
    whole, _, part = text.partition(".")
    return int(whole) * 10**9 + int(part.ljust(9, "0"))


if __name__ == "__main__":
    main()
