"""How fast the sensors are, against casting the same rays by Open3D, MuJoCo and pybullet.

`python -m bench.sensors` takes each figure several times, ours and the peers' in turn, one thread each, and prints
medians. World: the original structure with the robot, and as many more bars around it as are asked for. The peers cast
bare rays: their trees are built and the rays made beforehand; a moving scan is cast with all links where they are at
its beginning. Rows with a preset have everything: poses, errors, packing, the message. MuJoCo and pybullet run once,
and with more than 100 bars, where they take seconds to minutes, for the rows in `_FOR_ALL` alone.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.ray_peers import MujocoPeer, Open3DPeer, Part, PybulletPeer, Rays
from bench.sim import lattice
from services.sensors.depth.camera import DepthCamera, pinhole_of
from services.sensors.lidar.beam_files import read_beams
from services.sensors.lidar.beams import Beams
from services.sensors.lidar.effects import LidarEffects
from services.sensors.lidar.footprint import Footprint
from services.sensors.loading import load_lidar
from services.sensors.rays.interface import Poses
from services.sensors.rays.scan_conversion import ScanConversionBackend
from services.sensors.surroundings import Surroundings
from services.sim.climbing_sim import ClimbingSim
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import RobotDescription, StructureDescription, Transforms
from shared.robot.urdf import parse_urdf, read_urdf
from shared.runtime.config import CONFIGS_DIR, SimConfig
from shared.runtime.sensor_config import DepthConfig, LidarConfig

_URDF = read_urdf(CONFIGS_DIR / "robot" / "hyrecro.urdf")
_MARK = read_urdf(CONFIGS_DIR / "robot" / "fixed_foot.urdf")
_SCAN_NS, _NUM_POSES, _NUM_BLOCKS = 100_000_000, 11, 32
_TURN_RAD = 0.1
"""Of the whole robot about z during a moving scan: 1 rad/s."""
_NEAR_M, _FAR_M = 0.2, 100.0
_FEW_BARS = 100
_FOR_ALL = ("1024x128 uniform, still", "1024x128 uniform, moving", "depth 1280x720")
_WIDE = Footprint(0.01, float(np.deg2rad(0.18)))


@dataclass(frozen=True, slots=True)
class World:
    """What is seen, from where: transforms of a still moment and over a moving scan."""

    robot: RobotDescription
    structure: StructureDescription
    still: Transforms
    moving: list[Transforms]
    parts: list[Part]


@dataclass(frozen=True, slots=True)
class Case:
    """One line: what we do, and the rays that the peers cast for it."""

    name: str
    run: Callable[[], object]
    rays: Rays


@dataclass(frozen=True, slots=True)
class Figures:
    """Milliseconds; None where it was not asked for."""

    num_bars: int
    case: str
    ours_ms: float
    open3d_ms: float
    mujoco_ms: float | None
    pybullet_ms: float | None


def make_world(num_bars: int) -> World:
    """The robot in its first posture on a lattice of so many bars."""
    sim = ClimbingSim(SimConfig(), _URDF, lattice(num_bars), _MARK)
    said = {type(message): message for message in sim.start()}
    sim.close()
    robot, structure, still = said[RobotDescription], said[StructureDescription], said[Transforms]
    assert isinstance(robot, RobotDescription)
    assert isinstance(structure, StructureDescription)
    assert isinstance(still, Transforms)
    tree = FrameTree(still)
    shapes = [
        *parse_urdf(structure.urdf, "structure_description").shapes,
        *parse_urdf(robot.urdf, "robot_description").shapes,
    ]
    parts = [Part(shape.solid, tree.T_root(shape.link) @ shape.T_link_shape) for shape in shapes]
    moving = [_turned(still, i / (_NUM_POSES - 1)) for i in range(_NUM_POSES)]
    return World(robot, structure, still, moving, parts)


def _turned(transforms: Transforms, share: float) -> Transforms:
    """The same robot, turned about the vertical where its root stands."""
    poses = np.array(transforms.T_parent_child)
    root = transforms.parents.index(transforms.frame)
    turned = SE3.rot("z", _TURN_RAD * share) @ SE3.from_xyz_quat_xyzw(poses[root])
    poses[root] = SE3(turned.rotation, poses[root][:3]).xyz_quat_xyzw
    return replace(transforms, stamp_ns=round(share * _SCAN_NS), T_parent_child=poses)


def cases(world: World) -> Iterator[Case]:
    """Every line of the table."""
    yield from _lidar_cases(world)
    yield from _lidar_presets(world)
    yield from _depth_cases(world)


def _lidar_cases(world: World) -> Iterator[Case]:
    """Bare hits: a still sensor, and one with a pose a column; then what makes measurements of them."""
    seen = _surroundings("lidar", world)
    backend = _backend(seen)
    for table in ("uniform", "measured"):
        for num_columns in (512, 1024, 2048):
            beams = read_beams(CONFIGS_DIR / "sensors" / "beams" / f"os1_128_{table}.yaml", num_columns)
            for kind, poses in (("still", seen.poses([world.still], [0])), ("moving", _moving(seen, world, beams))):
                name = f"{num_columns}x128 {table}, {kind}"
                yield Case(name, partial(backend.scan, beams, poses, _NEAR_M, _FAR_M), _scan_rays(beams, poses))
    yield Case(
        "sub-rays at its edges", partial(backend.edges, beams, poses, _NEAR_M, _FAR_M, _WIDE), _scan_rays(beams, poses)
    )
    beams = read_beams(CONFIGS_DIR / "sensors" / "beams" / "os1_128_uniform.yaml", 1024)
    poses = _moving(seen, world, beams)
    assert seen.scene is not None
    effects = LidarEffects(LidarConfig.model_validate({"preset": "datasheet"}), beams, seen.scene, slice(0), seed=1)

    def measure_scan() -> object:
        return effects.apply(backend.scan(beams, poses, _NEAR_M, _FAR_M), None, 0)

    yield Case("1024x128 moving, noise, dropouts, packing", measure_scan, _scan_rays(beams, poses))


def _lidar_presets(world: World) -> Iterator[Case]:
    """All that a LiDAR does from transforms to message."""
    seen = _surroundings("lidar", world)
    for preset in ("ideal", "original", "datasheet"):
        for mode in ("512x10", "1024x10", "2048x10"):
            config = LidarConfig.model_validate({"preset": preset, "mode": mode})
            lidar = load_lidar(config, seed=1)
            lidar.set_robot(world.robot)
            lidar.set_structure(world.structure)
            beams = read_beams(config.beams, config.num_columns)
            is_moving = config.rolling_shutter
            poses = _moving(seen, world, beams) if is_moving else seen.poses([world.still], [0])
            rays = _scan_rays(beams, poses, config.near_clip_m, config.max_range_m)
            scan = partial(lidar.scan, world.moving if is_moving else [world.still])
            yield Case(f"LiDAR {preset}, {mode}", scan, rays)


def _depth_cases(world: World) -> Iterator[Case]:
    """Bare depths, and all that a camera does from transforms to message."""
    seen = _surroundings("depth_optical", world)
    backend, poses = _backend(seen), seen.poses([world.still], [0])
    for mode in ("848x480", "1280x720"):
        for preset in ("ideal", "original", "datasheet"):
            config = DepthConfig.model_validate({"preset": preset, "mode": mode, "max_range_m": 10.0})
            camera = pinhole_of(config)
            origins_m = np.repeat(poses.sensor_translation_m, camera.height, axis=0)
            limits_m = config.near_clip_m, 2 * config.max_range_m
            rays = Rays(origins_m, camera.rays() @ poses.sensor_rotation[0].T, *limits_m)
            if preset == "ideal":
                yield Case(f"depth {mode}", partial(backend.image, camera, poses, *limits_m), rays)
            sensor = DepthCamera(config, 1, lambda: False)
            sensor.set_robot(world.robot)
            sensor.set_structure(world.structure)
            yield Case(f"depth camera {preset}, {mode}", partial(sensor.image, world.still), rays)


def _moving(seen: Surroundings, world: World, beams: Beams) -> Poses:
    stamps_ns = np.arange(beams.num_columns) * _SCAN_NS // beams.num_columns
    return seen.poses(world.moving, stamps_ns, _NUM_BLOCKS)


def _surroundings(frame: str, world: World) -> Surroundings:
    seen = Surroundings(frame, sees_robot=True, sensor_name=frame)
    seen.set_robot(world.robot)
    seen.set_structure(world.structure)
    return seen


def _backend(seen: Surroundings) -> ScanConversionBackend:
    backend = ScanConversionBackend()
    assert seen.scene is not None
    backend.set_scene(seen.scene)
    return backend


def _scan_rays(beams: Beams, poses: Poses, near_m: float = _NEAR_M, far_m: float = _FAR_M) -> Rays:
    R = np.broadcast_to(poses.sensor_rotation, (beams.num_columns, 3, 3))
    origins_m = np.einsum("nij,nj->ni", R, beams.origins_m()) + poses.sensor_translation_m
    return Rays(origins_m, np.einsum("nij,nrj->nri", R, beams.directions()), near_m, far_m)


def measure(num_bars: int, num_runs: int, *, with_slow_peers: bool) -> list[Figures]:
    """All lines of one world: ours and Open3D's medians of `num_runs` in turn, the slow peers once."""
    world = make_world(num_bars)
    open3d = Open3DPeer(world.parts)
    mujoco, pybullet = (MujocoPeer(world.parts), PybulletPeer(world.parts)) if with_slow_peers else (None, None)
    lines = []
    for case in cases(world):
        case.run()
        open3d.prepare(case.rays)
        ours_s, open3d_s = [], []
        for _ in range(num_runs):
            ours_s.append(_seconds(case.run))
            open3d_s.append(_seconds(partial(open3d.cast, case.rays)))
        is_asked = num_bars <= _FEW_BARS or case.name in _FOR_ALL
        slow_ms = [
            1e3 * _seconds(partial(peer.cast, case.rays)) if peer is not None and is_asked else None
            for peer in (mujoco, pybullet)
        ]
        ours_ms, open3d_ms = (1e3 * statistics.median(times) for times in (ours_s, open3d_s))
        lines.append(Figures(num_bars, case.name, ours_ms, open3d_ms, *slow_ms))
        if sys.stderr.isatty():
            print(f"{num_bars} bars: {case.name}", file=sys.stderr)
    if pybullet is not None:
        pybullet.close()
    return lines


def _seconds(run: Callable[[], object]) -> float:
    started = time.perf_counter()
    run()
    return time.perf_counter() - started


def main() -> None:
    """Measures and prints a table, or JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.sensors", description=__doc__)
    parser.add_argument("--bars", type=int, nargs="+", default=[21, 1000, 10_000])
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--fast-peers", action="store_true", help="without MuJoCo and pybullet, which take minutes")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one thread each, whatever a library would like
    lines = [
        line
        for bars in arguments.bars
        for line in measure(bars, arguments.runs, with_slow_peers=not arguments.fast_peers)
    ]
    if arguments.json:
        print(json.dumps([asdict(line) for line in lines], indent=2))
        return
    table = Table("bars", "case", "ours ms", "Open3D ms", "ratio", "MuJoCo ms", "pybullet ms")
    for line in lines:
        slow = ("-" if each is None else f"{each:.0f}" for each in (line.mujoco_ms, line.pybullet_ms))
        ratio = f"{line.open3d_ms / line.ours_ms:.1f}"
        table.add_row(str(line.num_bars), line.case, f"{line.ours_ms:.2f}", f"{line.open3d_ms:.1f}", ratio, *slow)
    Console().print(table)


if __name__ == "__main__":
    main()
