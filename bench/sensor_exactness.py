"""How exactly drawing faces agrees with casting rays: `python -m bench.sensor_exactness`.

Sensors at random places and attitudes in the original structure, the robot in it; uniform and measured beams, still and
with a pose a column, near clips of 0.2 and 0.05 m; images of 848 x 480. Counted are rays that differ from Embree's by
more than a millimetre, and those of them that no silhouette explains: where Embree says the same a hundred-thousandth
of a radian beside.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.sensors import make_world
from services.sensors.depth.pinhole import Pinhole
from services.sensors.lidar.beam_files import read_beams
from services.sensors.rays.embree import EmbreeBackend
from services.sensors.rays.interface import Hits, Poses
from services.sensors.rays.scan_conversion import ScanConversionBackend
from services.sensors.surroundings import Surroundings
from shared.geometry import SE3
from shared.motion import Motion
from shared.runtime.config import CONFIGS_DIR

_NUM_COLUMNS, _NUM_BLOCKS = 512, 16
_TOLERANCE_M = 0.001
_BESIDE_RAD = 1e-5
_CAMERA = Pinhole(480, 848, 427.0, 427.0, 423.5, 239.5)


@dataclass(slots=True)
class Count:
    """Of one kind of sensor: rays, those that differ, and those of them that lie on no silhouette."""

    kind: str
    num_rays: int = 0
    num_different: int = 0
    num_unexplained: int = 0


class Comparison:
    """Both backends in front of the same scene."""

    def __init__(self) -> None:
        world = make_world(21)
        self._seen = Surroundings("lidar", sees_robot=True, sensor_name="lidar")
        self._seen.set_robot(world.robot)
        self._seen.set_structure(world.structure)
        assert self._seen.scene is not None
        self._still = self._seen.poses([world.still], [0])
        self._drawn, self._cast = ScanConversionBackend(), EmbreeBackend()
        for backend in (self._drawn, self._cast):
            backend.set_scene(self._seen.scene)

    def add_scan(self, count: Count, rng: np.random.Generator, *, is_moving: bool, table: str, near_m: float) -> None:
        """One scan from somewhere."""
        beams = read_beams(CONFIGS_DIR / "sensors" / "beams" / f"os1_128_{table}.yaml", _NUM_COLUMNS)
        poses, far_m = self._somewhere(rng, is_moving=is_moving), float(rng.choice([10.0, 100.0]))
        ours, theirs = (backend.scan(beams, poses, near_m, far_m) for backend in (self._drawn, self._cast))
        different = _differing(ours, theirs)
        explained = np.zeros_like(different)
        if different.any():
            for turn in ((_BESIDE_RAD, 0), (-_BESIDE_RAD, 0), (0, _BESIDE_RAD), (0, -_BESIDE_RAD)):
                elevation, azimuth = beams.elevation_rad + turn[0], beams.azimuth_rad + turn[1]
                beside = replace(beams, elevation_rad=elevation, azimuth_rad=azimuth)
                explained |= ~_differing(ours, self._cast.scan(beside, poses, near_m, far_m))
        _add(count, different, explained)

    def add_image(self, count: Count, rng: np.random.Generator) -> None:
        """One image from somewhere."""
        poses, near_m = self._somewhere(rng, is_moving=False), float(rng.choice([0.05, 0.2]))
        ours, theirs = (backend.image(_CAMERA, poses, near_m, 10.0) for backend in (self._drawn, self._cast))
        different, explained = _differing(ours, theirs), np.zeros(ours.face.shape, dtype=np.bool_)
        shift_px = _BESIDE_RAD * _CAMERA.fx
        if different.any():
            for u, v in ((shift_px, 0), (-shift_px, 0), (0, shift_px), (0, -shift_px)):
                beside = replace(_CAMERA, cx=_CAMERA.cx + u, cy=_CAMERA.cy + v)
                explained |= ~_differing(ours, self._cast.image(beside, poses, near_m, 10.0))
        _add(count, different, explained)

    def _somewhere(self, rng: np.random.Generator, *, is_moving: bool) -> Poses:
        """In the structure's upper part; moving: by up to 0.1 m and 0.1 rad a scan."""
        where = SE3.from_rpy(rng.uniform(-np.pi, np.pi, 3), rng.uniform([-2.5, -2.5, 7.0], [2.5, 2.5, 12.0]))
        if not is_moving:
            return replace(
                self._still,
                sensor_rotation=where.rotation[np.newaxis],
                sensor_translation_m=where.translation[np.newaxis],
            )
        end = where @ SE3.from_rpy(rng.uniform(-0.06, 0.06, 3), rng.uniform(-0.06, 0.06, 3))
        motion = Motion([0, _NUM_COLUMNS], [[where.xyz_quat_xyzw], [end.xyz_quat_xyzw]])
        R, t = motion.at(np.arange(_NUM_COLUMNS))
        links = np.repeat(self._still.link_rotation, _NUM_BLOCKS, axis=0)
        shifts_m = np.linspace(0, 0.01, _NUM_BLOCKS)[:, np.newaxis, np.newaxis] * rng.uniform(-1, 1, 3)
        return Poses(R[:, 0], t[:, 0], links, self._still.link_translation_m + shifts_m)


def _differing(ours: Hits, theirs: Hits) -> NDArray[np.bool_]:
    both = np.isfinite(ours.range_m) & np.isfinite(theirs.range_m)
    with np.errstate(invalid="ignore"):
        is_apart = np.abs(ours.range_m - theirs.range_m) > _TOLERANCE_M
    different: NDArray[np.bool_] = np.where(both, is_apart, np.isfinite(ours.range_m) != np.isfinite(theirs.range_m))
    return different


def _add(count: Count, different: NDArray[np.bool_], explained: NDArray[np.bool_]) -> None:
    count.num_rays += different.size
    count.num_different += int(different.sum())
    count.num_unexplained += int((different & ~explained).sum())


def main() -> None:
    """Compares and prints a table, or JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.sensor_exactness", description=__doc__)
    parser.add_argument("--poses", type=int, default=100, help="of each kind of sensor")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rng, comparison, counts = np.random.default_rng(arguments.seed), Comparison(), []
    for table in ("uniform", "measured"):
        for is_moving in (False, True):
            count = Count(f"{table} beams, {'moving' if is_moving else 'still'}")
            for i in range(arguments.poses):
                near_m = (0.2, 0.05)[i % 2]
                comparison.add_scan(count, rng, is_moving=is_moving, table=table, near_m=near_m)
            counts.append(count)
    image = Count("848x480 images")
    for _ in range(arguments.poses):
        comparison.add_image(image, rng)
    counts.append(image)
    if arguments.json:
        print(json.dumps([asdict(count) for count in counts], indent=2))
        return
    lines = Table("sensor", "rays", "differ by more than 1 mm", "on no silhouette")
    for count in counts:
        lines.add_row(count.kind, f"{count.num_rays:,}", str(count.num_different), str(count.num_unexplained))
    Console().print(lines)


if __name__ == "__main__":
    main()
