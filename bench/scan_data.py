"""Scans from a sensor that flies through a structure, without any robot: `python -m bench.scan_data OUT`.

Writes data0.pcd ..., truth.tum and structure.yaml. The path is smooth and periodic, keeps clear of the steel, and is
the same for the same seed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from services.evaluator.map_accuracy import distances_to_shapes
from services.sensors.loading import load_lidar
from shared.cloud_files import write_scan
from shared.geometry import SE3
from shared.messaging.messages import RobotDescription, StructureDescription, Transforms
from shared.robot.urdf import parse_urdf
from shared.runtime.sensor_config import LidarConfig
from shared.trajectory_files import write_tum
from shared.world.files import load_structure, save_structure
from shared.world.generator import Lattice, crossed_truss, orthogonal_truss, tower
from shared.world.structure import Member, Structure
from shared.world.urdf_format import structure_urdf

Float = NDArray[np.float64]

_SENSOR_URDF = '<robot name="sensor"><link name="lidar"/></robot>'
_PERIOD_NS = 1_000_000_000
_KINDS: dict[str, Callable[[Lattice], Structure]] = {
    "orthogonal": orthogonal_truss,
    "crossed": crossed_truss,
    "tower": tower,
}


@dataclass(frozen=True, slots=True)
class Path6:
    """A closed path: each of x y z (m) and roll pitch yaw (rad) is a middle and a few sines of the share of the way.

    middle (6,), amplitudes and phases_rad (H, 6): of the sines with 1 to H periods. travel (6,): what is added over the
    whole way, so that yaw may turn on and the sensor may move along a bridge.
    """

    middle: Float
    amplitudes: Float
    phases_rad: Float
    travel: Float

    def at(self, share: float) -> SE3:
        """The pose at a share of the way, 0..1."""
        periods = np.arange(1, len(self.amplitudes) + 1)[:, np.newaxis]
        sines = self.amplitudes * np.sin(2 * np.pi * periods * share + self.phases_rad)
        values = self.middle + sines.sum(axis=0) + share * self.travel
        return SE3.from_rpy(values[3:], values[:3])


def random_path(middle: Float, reach: Float, travel: Float, rng: np.random.Generator) -> Path6:
    """Phases at random; the first sine has the whole reach (6,), the second a third of it."""
    amplitudes: Float = np.array([reach, reach / 3])
    return Path6(middle, amplitudes, rng.uniform(-np.pi, np.pi, amplitudes.shape), travel)


def poses_clear_of(
    structure: Structure, draw: Callable[[], Path6], num_scans: int, clearance_m: float, num_tries: int = 1000
) -> tuple[SE3, ...]:
    """Poses along the first path drawn that keeps so far from all steel.

    Raises:
        ValueError: none of many did.
    """
    shapes = parse_urdf(structure_urdf(structure), structure.name).shapes
    for _ in range(num_tries):
        path = draw()
        fine_m = np.array([path.at(share).translation for share in np.linspace(0, 1, 4 * num_scans)])
        if distances_to_shapes(fine_m, shapes).min() >= clearance_m:
            return tuple(path.at(share) for share in np.linspace(0, 1, num_scans))
    raise ValueError(f"no path found that keeps {clearance_m:g} m from the steel")


def write_scans(out: Path, structure: Structure, poses: Sequence[SE3], config: LidarConfig, seed: int) -> None:
    """Scans from poses T_world_lidar, a second apart, with their truth, into a new folder.

    Raises:
        FileExistsError: the folder is there.
    """
    out.mkdir(parents=True)
    save_structure(structure, out / "structure.yaml")
    lidar = load_lidar(config, seed)
    lidar.set_robot(RobotDescription(stamp_ns=0, seq=0, frame="lidar", urdf=_SENSOR_URDF))
    lidar.set_structure(StructureDescription(stamp_ns=0, seq=0, frame="world", urdf=structure_urdf(structure)))
    for i, T_world_lidar in enumerate(poses):
        transforms = Transforms(
            stamp_ns=i * _PERIOD_NS,
            seq=i,
            frame="world",
            parents=("world",),
            children=("lidar",),
            T_parent_child=T_world_lidar.xyz_quat_xyzw[np.newaxis],
        )
        write_scan(out / f"data{i}.pcd", lidar.scan([transforms]))
    write_tum(out / "truth.tum", [(i * _PERIOD_NS, pose) for i, pose in enumerate(poses)])


def turned(structure: Structure, rpy_deg: Sequence[float]) -> Structure:
    """The members turned about the origin; the ground, if any, stays."""
    T = SE3.from_rpy(np.deg2rad(rpy_deg))
    members = (Member(member.name, member.solid, T @ member.T_world_member) for member in structure.members)
    return Structure(structure.name, tuple(members), structure.ground_z_m)


def _structure(arguments: argparse.Namespace) -> Structure:
    if Path(arguments.structure).suffix:
        return load_structure(Path(arguments.structure))
    bays = tuple(int(number) for number in arguments.bays.split("x"))
    lattice = Lattice(
        spacing_m=arguments.spacing, width_m=arguments.width, bays=(bays[0], bays[1], bays[2]), ground_z_m=None
    )
    return turned(_KINDS[arguments.structure](lattice), arguments.turn)


def main() -> None:
    """Makes one set of scans."""
    parser = argparse.ArgumentParser(prog="python -m bench.scan_data", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--structure", default="crossed", help=f"a file, or {', '.join(_KINDS)}")
    parser.add_argument("--bays", default="2x2x3")
    parser.add_argument("--spacing", type=float, default=2.0)
    parser.add_argument("--width", type=float, default=0.15)
    parser.add_argument("--turn", type=float, nargs=3, default=[0.0, 0.0, 0.0], help="roll pitch yaw in degrees")
    parser.add_argument("--middle", type=float, nargs=3, default=[0.0, 0.0, 3.0], help="of the path, before the turn")
    parser.add_argument("--reach", type=float, nargs=3, default=[0.4, 0.4, 0.8])
    parser.add_argument("--reach-deg", type=float, nargs=3, default=[25.0, 25.0, 90.0])
    parser.add_argument("--travel", type=float, nargs=3, default=[0.0, 0.0, 0.0])
    parser.add_argument("--scans", type=int, default=60)
    parser.add_argument("--noise", type=float, default=0.008, help="standard deviation of a range [m]")
    parser.add_argument("--clearance", type=float, default=0.3)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    R = SE3.from_rpy(np.deg2rad(arguments.turn)).rotation
    middle, travel = (np.concatenate([R @ np.array(v), np.zeros(3)]) for v in (arguments.middle, arguments.travel))
    reach = np.concatenate([arguments.reach, np.deg2rad(arguments.reach_deg)])
    rng, structure = np.random.default_rng(arguments.seed), _structure(arguments)
    poses = poses_clear_of(
        structure, lambda: random_path(middle, reach, travel, rng), arguments.scans, arguments.clearance
    )
    config = LidarConfig.model_validate({"preset": "original", "range_noise_m": arguments.noise, "self_hits": False})
    write_scans(arguments.out, structure, poses, config, arguments.seed)
    print(f"{len(poses)} scans in {arguments.out}")


if __name__ == "__main__":
    main()
