"""How good the poses of a run are, and the map that they make: the same for all who made them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from bench.mapping.scans import ScanSet
from services.evaluator.map_accuracy import map_accuracy, num_points_off_planes
from services.evaluator.trajectory_error import compare_trajectories
from shared.geometry import SE3
from shared.robot.description import UrdfModel
from shared.robot.urdf import parse_urdf
from shared.runtime.config import CONFIGS_DIR
from shared.world.files import load_structure
from shared.world.urdf_format import structure_urdf

_VOXEL_M = 0.05
_MAX_SCANS_OF_MAP = 100
_NUM_PLANES, _PLANE_DISTANCE_M, _SEED = 11, 0.04, 0
_PAIR_M, _PAIR_RAD = 0.05, float(np.deg2rad(1.0))
"""A step between two scans is right within these."""


@dataclass(frozen=True, slots=True)
class Score:
    """First poses laid together, no other alignment. num_map_points: of the map that the last two figures are of."""

    ate_mm: float
    rpe_mm: float
    rpe_deg: float
    num_pairs_ok: int
    num_pairs: int
    num_map_points: int
    num_off_planes: int
    map_accuracy_mm: float


def structure_of(directory: Path) -> UrdfModel:
    """The set's own structure.yaml, or the original structure."""
    own = directory / "structure.yaml"
    structure = load_structure(own if own.is_file() else CONFIGS_DIR / "structures" / "original.yaml")
    return parse_urdf(structure_urdf(structure), structure.name)


def score(poses: Sequence[SE3], scan_set: ScanSet, structure: UrdfModel) -> Score:
    """Of poses T_map_lidar, one a scan."""
    trajectory = compare_trajectories(poses, scan_set.truth)
    T_world_map = scan_set.truth[0] @ poses[0].inv()
    map_m = thinned_map([T_world_map @ pose for pose in poses], scan_set)
    return Score(
        ate_mm=1e3 * trajectory.ate_rmse_m,
        rpe_mm=1e3 * trajectory.rpe_rmse_m,
        rpe_deg=float(np.rad2deg(trajectory.rpe_rmse_rad)),
        num_pairs_ok=num_pairs_ok(poses, scan_set.truth),
        num_pairs=len(poses) - 1,
        num_map_points=len(map_m),
        num_off_planes=num_points_off_planes(map_m, num_planes=_NUM_PLANES, distance_m=_PLANE_DISTANCE_M, seed=_SEED),
        map_accuracy_mm=1e3 * map_accuracy(map_m, structure).mean_m,
    )


def num_pairs_ok(poses: Sequence[SE3], truth: Sequence[SE3]) -> int:
    """How many steps from one scan to the next are right within 5 cm and 1 degree."""
    return sum(_are_right(poses, truth))


def num_silent(poses: Sequence[SE3], truth: Sequence[SE3], is_lost: Sequence[bool]) -> int:
    """How many steps are wrong between two scans of which neither is said to be lost."""
    told = [before or after for before, after in pairwise(is_lost)]
    return sum(not is_right and not is_told for is_right, is_told in zip(_are_right(poses, truth), told, strict=True))


def thinned_map(poses: Sequence[SE3], scan_set: ScanSet) -> NDArray[np.float64]:
    """Mean point (N, 3) of each 0.05 m voxel of the scans laid at their poses; of long runs 100 scans, evenly."""
    rows = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), _MAX_SCANS_OF_MAP)).round().astype(int))
    points_m = np.concatenate([poses[k].apply(scan_set.scans_m[k].astype(np.float64)) for k in rows])
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m)).voxel_down_sample(_VOXEL_M)
    return np.asarray(cloud.points)


def _are_right(poses: Sequence[SE3], truth: Sequence[SE3]) -> list[bool]:
    errors = [true.inv() @ step for step, true in zip(_steps(poses), _steps(truth), strict=True)]
    return [bool(np.linalg.norm(e.translation) <= _PAIR_M and e.angle_rad <= _PAIR_RAD) for e in errors]


def _steps(poses: Sequence[SE3]) -> list[SE3]:
    return [a.inv() @ b for a, b in pairwise(poses)]
