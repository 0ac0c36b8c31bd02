"""What can be done once a run is over: loops are closed, poses and planes estimated together, the map made anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.mapper.loop_closure import close_loops
from services.mapper.mapper import Registered
from services.mapper.planes.growth import map_of_scans
from services.mapper.planes.matcher import PlaneMatcher
from services.mapper.planes.refinement import refine_run
from services.mapper.registration import Points, ScanMatcher
from services.mapper.voxel_map import VoxelMap
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

_KEYFRAME_STEP_M, _KEYFRAME_STEP_RAD = 0.3, 0.35
"""From keyframe to keyframe, where loops are closed: what two scans of a lattice share is then still most of it."""


@dataclass(frozen=True, slots=True, eq=False)
class RefinedRun:
    """poses: T_map_sensor of each scan as it was registered; how many returns closed a loop; the map's cloud (N, 3)."""

    poses: list[SE3]
    num_loops: int
    map_points_m: NDArray[np.float64]


def refined(run: Sequence[Registered], matcher: ScanMatcher, config: MapperConfig) -> RefinedRun:
    """The run as its whole sees it.

    matcher: of the run. Its planes are the beginning where they are those of the map; otherwise, as where only the last
    scan was the target, loops are closed first and planes found then. A lost scan keeps its step from the one before.

    Raises:
        RegistrationError: no scan shows planes.
    """
    tracked = [k for k, scan in enumerate(run) if scan.is_tracked]
    scans, poses = [run[k].points_m for k in tracked], [run[k].T_map_sensor for k in tracked]
    num_loops = 0
    if isinstance(matcher, PlaneMatcher) and config.scan_to == "map":
        patch_map = matcher.patch_map
    else:
        poses, num_loops = _with_loops_closed(scans, poses, config)
        patch_map = map_of_scans(scans, [pose.matrix[:3] for pose in poses], config)
    poses = refine_run(scans, poses, patch_map, config).poses
    voxels = VoxelMap(config.voxel_size_m, config.max_map_points)
    for points_m, pose in zip(scans, poses, strict=True):
        voxels.insert(pose.apply(points_m))
    return RefinedRun(_with_lost(run, dict(zip(tracked, poses, strict=True))), num_loops, voxels.points_m)


def _with_loops_closed(scans: Sequence[Points], poses: Sequence[SE3], config: MapperConfig) -> tuple[list[SE3], int]:
    """Each pose moved along with the last keyframe before it."""
    keyframes = [0]
    for k, pose in enumerate(poses):
        step = poses[keyframes[-1]].inv() @ pose
        if np.linalg.norm(step.translation) > _KEYFRAME_STEP_M or step.angle_rad > _KEYFRAME_STEP_RAD:
            keyframes.append(k)
    closed = close_loops([scans[k] for k in keyframes], [poses[k] for k in keyframes], config)
    moved: list[SE3] = []
    for number, first in enumerate(keyframes):
        last = keyframes[number + 1] if number + 1 < len(keyframes) else len(poses)
        correction = closed.T_map_lidar[number] @ poses[first].inv()
        moved += [correction @ pose for pose in poses[first:last]]
    return moved, len(closed.returns)


def _with_lost(run: Sequence[Registered], found: dict[int, SE3]) -> list[SE3]:
    poses: list[SE3] = []
    for k, scan in enumerate(run):
        step = run[k - 1].T_map_sensor.inv() @ scan.T_map_sensor if k else scan.T_map_sensor
        poses.append(found[k] if k in found else (poses[-1] @ step if poses else step))
    return poses
