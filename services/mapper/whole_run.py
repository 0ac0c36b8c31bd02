"""What can be done once a run is over: all poses and planes are estimated together, and the map is made anew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from services.mapper.planes.growth import map_of_scans
from services.mapper.planes.matcher import PlaneMatcher
from services.mapper.planes.refinement import refine
from services.mapper.registration import Points, ScanMatcher
from services.mapper.voxel_map import VoxelMap
from shared.geometry import SE3
from shared.runtime.config import MapperConfig


def refined_poses(
    scans: Sequence[Points],
    poses: Sequence[SE3],
    is_tracked: Sequence[bool],
    matcher: ScanMatcher,
    config: MapperConfig,
) -> list[SE3]:
    """T_map_sensor of each scan, estimated together with the planes that the tracked scans show.

    scans: filtered, (N, 3) each, in the sensor's frame. matcher: of the run; where it knows no planes, they are found
    in the scans first. A lost scan keeps its step from the last tracked one.

    Raises:
        RegistrationError: no scan shows planes.
    """
    tracked = [k for k, is_known in enumerate(is_tracked) if is_known]
    kept_scans, kept_poses = [scans[k] for k in tracked], [poses[k] for k in tracked]
    if isinstance(matcher, PlaneMatcher) and config.scan_to == "map":
        patch_map = matcher.patch_map
    else:
        patch_map = map_of_scans(kept_scans, [pose.matrix[:3] for pose in kept_poses], config)
    found = dict(zip(tracked, refine(kept_scans, kept_poses, patch_map).poses, strict=True))
    refined: list[SE3] = []
    for k, pose in enumerate(poses):
        refined.append(found[k] if k in found else refined[-1] @ poses[k - 1].inv() @ pose if k else pose)
    return refined


def map_of(
    scans: Sequence[Points], poses: Sequence[SE3], is_tracked: Sequence[bool], config: MapperConfig
) -> np.ndarray:
    """The map's cloud (N, 3) of the tracked scans at these poses."""
    voxels = VoxelMap(config.voxel_size_m, config.max_map_points)
    for points_m, pose, is_known in zip(scans, poses, is_tracked, strict=True):
        if is_known:
            voxels.insert(pose.apply(points_m))
    return voxels.points_m
