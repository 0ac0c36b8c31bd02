"""Scores a trajectory, and the map made along it, that stand in files."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cli.clouds import finite_points
from services.evaluator import association
from services.evaluator.alignment import Alignment, aligned
from services.evaluator.map_accuracy import num_points_off_planes
from services.evaluator.map_entropy import mean_map_entropy
from services.evaluator.map_quality import MapQuality, compare_map
from services.evaluator.trajectory_error import TrajectoryComparison, TrajectoryError, errors_by_distance
from shared.errors import HyrecroError
from shared.geometry import SE3
from shared.robot.urdf import parse_urdf
from shared.runtime.config import Config
from shared.trajectory_files import read_tum
from shared.world.files import load_structure
from shared.world.urdf_format import structure_urdf

Float = NDArray[np.float64]
StampedPoses = list[tuple[int, SE3]]

MME_RADIUS_M = 0.15
"""Three voxels of the default map: a neighbourhood on one face of a bar of 0.2 m."""
_MME_QUERIES = 2000
_NUM_EYES = 20
MAP_FIGURES = (
    "map_points",
    "map_accuracy_mean_m",
    "map_accuracy_p95_m",
    "map_accuracy_rmse_m",
    "map_accuracy_max_m",
    "completeness_1cm",
    "completeness_2cm",
    "completeness_5cm",
    "fscore_1cm",
    "fscore_2cm",
    "fscore_5cm",
    "chamfer_m",
    "mme",
    "off_plane_points",
)


@dataclass(slots=True)
class Evaluation:
    """figures: what is printed as JSON. estimated, true: pairwise, in the world. errors (N, 2): metres and radians of
    each pair. map_points_m (M, 3) in the world and distances_m (M,) to steel, None without a map.

    warnings: what the user should know of the data.
    """

    figures: dict[str, Any]
    estimated: StampedPoses
    true: StampedPoses
    errors: Float
    map_points_m: Float | None = None
    distances_m: Float | None = None
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class MapFiles:
    """A map in the frame of the first scan, and the structure it is a map of."""

    cloud: Path
    structure: Path


def evaluate(
    estimate: Path, truth: Path, alignment: Alignment, max_dt_s: float, files: MapFiles | None, config: Config
) -> Evaluation:
    """The scores of an estimated trajectory, and of a map where one is given.

    Raises:
        InputFileError, ConfigError: a file is not there, or is no structure.
        CloudFileError, TrajectoryFileError: the content of a file cannot be used.
        HyrecroError: the trajectories have no stamps in common, or cannot be aligned that way.
    """
    estimated, true = read_tum(estimate), read_tum(truth)
    warnings: list[str] = []
    pairs = _paired(estimate, estimated, truth, true, max_dt_s, warnings)
    estimated, true = [estimated[i] for i in pairs[:, 0]], [true[j] for j in pairs[:, 1]]
    T_map_lidar, T_world_lidar = [pose for _, pose in estimated], [pose for _, pose in true]
    try:
        T_world_map = aligned(alignment, T_map_lidar, T_world_lidar)
    except ValueError as error:
        raise HyrecroError(f"{estimate}: {error}") from error
    comparison = TrajectoryComparison(T_world_map)
    left = [comparison.add(*pair) for pair in zip(T_map_lidar, T_world_lidar, strict=True)]
    errors = np.array([[np.linalg.norm(error.translation), error.angle_rad] for error in left])
    figures = {"align": alignment.value} | _trajectory_figures(comparison.result())
    figures["rpe_by_distance"] = [
        {
            "length_m": part.length_m,
            "num_segments": part.num_segments,
            "rmse_m": part.rmse_m,
            "rot_rmse_deg": math.degrees(part.rmse_rad),
        }
        for part in errors_by_distance(T_map_lidar, T_world_lidar)
    ]
    in_world = [(stamp_ns, T_world_map @ pose) for stamp_ns, pose in estimated]
    result = Evaluation(figures | dict.fromkeys(MAP_FIGURES), in_world, true, errors, warnings=warnings)
    if files is not None:
        _add_map(result, files, T_world_map, config)
    return result


def _paired(
    estimate: Path,
    estimated: StampedPoses,
    truth: Path,
    true: StampedPoses,
    max_dt_s: float,
    warnings: list[str],
) -> association.Pairs:
    """By stamp; or by index, where the stamps of the estimate count the scans and most are none of the truth's."""
    pairs = association.by_stamp(estimated, true, round(max_dt_s * 1e9))
    if 2 * len(pairs) < len(estimated) and association.is_indexed(estimated, len(true)):
        warnings.append(f"{estimate}: its stamps count the poses of {truth} and are paired with them so")
        return association.by_index(estimated, true)
    if len(pairs) == 0:
        raise HyrecroError(f"{estimate}: no stamp is within {max_dt_s:g} s of one in {truth}")
    if num_alone := len(estimated) - len(pairs):
        warnings.append(f"{estimate}: {num_alone} of {len(estimated)} poses have none within {max_dt_s:g} s in {truth}")
    return pairs


def _trajectory_figures(error: TrajectoryError) -> dict[str, Any]:
    return {
        "num_poses": error.num_poses,
        "ate_rmse_m": error.ate_rmse_m,
        "ate_mean_m": error.ate_mean_m,
        "ate_max_m": error.ate_max_m,
        "ate_rot_rmse_deg": math.degrees(error.ate_rot_rmse_rad),
        "rpe_rmse_m": error.rpe_rmse_m,
        "rpe_rot_rmse_deg": math.degrees(error.rpe_rmse_rad),
        "drift_m": error.drift_m,
        "drift_percent": None if error.drift_share is None else 100 * error.drift_share,
        "path_m": error.path_m,
        "num_pairs": error.num_pairs,
        "pairs_ok": error.pairs_ok,
    }


def _add_map(result: Evaluation, files: MapFiles, T_world_map: SE3, config: Config) -> None:
    structure = parse_urdf(structure_urdf(load_structure(files.structure)), str(files.structure))
    points_m = finite_points(files.cloud, result.warnings.append)
    chosen = np.unique(np.linspace(0, len(result.true) - 1, _NUM_EYES).round().astype(int))
    eyes_m = np.array([result.true[row][1].translation for row in chosen])
    rng = np.random.default_rng(config.seed)
    in_world = np.asarray(T_world_map.apply(points_m), dtype=np.float64)
    quality = compare_map(in_world, structure, rng=rng, eyes_m=eyes_m, max_range_m=config.mapper.max_range_m)
    settings = config.evaluator
    result.figures |= _map_figures(quality) | {
        "mme": mean_map_entropy(points_m, radius_m=MME_RADIUS_M, max_queries=_MME_QUERIES, rng=rng),
        "off_plane_points": num_points_off_planes(
            points_m, num_planes=settings.num_planes, distance_m=settings.plane_distance_m, seed=config.seed
        ),
    }
    result.map_points_m, result.distances_m = in_world, quality.distances_m


def _map_figures(quality: MapQuality) -> dict[str, Any]:
    figures: dict[str, Any] = {
        "map_points": quality.accuracy.num_points,
        "map_accuracy_mean_m": quality.accuracy.mean_m,
        "map_accuracy_p95_m": quality.accuracy.p95_m,
        "map_accuracy_rmse_m": quality.accuracy.rmse_m,
        "map_accuracy_max_m": quality.accuracy.max_m,
        "chamfer_m": quality.chamfer_m,
    }
    for threshold_m, share in (quality.completeness or {}).items():
        figures[f"completeness_{threshold_m * 100:.0f}cm"] = share
    for threshold_m, share in (quality.fscore or {}).items():
        figures[f"fscore_{threshold_m * 100:.0f}cm"] = share
    return figures
