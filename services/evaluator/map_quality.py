"""A map against the true structure both ways: how near its points are to steel, and how much of the steel it holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.evaluator.map_accuracy import MapAccuracy, accuracy_of, distances_to_map, distances_to_structure
from services.evaluator.surface import SurfaceSamples, TrueSurface
from shared.robot.description import UrdfModel

Float = NDArray[np.float64]

THRESHOLDS_M = (0.01, 0.02, 0.05)
NUM_SAMPLES = 100_000
"""Of the true surface: completeness is then known to 0.2 % or better."""
_GROWTH_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class MapQuality:
    """distances_m (N,): of the map's points to the nearest true surface; accuracy sums them up.

    completeness: share of the surface that could be seen within each threshold in metres of a map point; at thresholds
    below the spacing of the map's points that spacing shows. fscore: harmonic mean of it and of the share of map points
    within the threshold of the surface. chamfer_m: mean of the mean distances both ways. None: nothing could be seen.
    """

    distances_m: Float
    accuracy: MapAccuracy
    completeness: dict[float, float] | None
    fscore: dict[float, float] | None
    chamfer_m: float | None


def compare_map(
    points_world_m: NDArray[np.floating],
    structure: UrdfModel,
    *,
    rng: np.random.Generator,
    eyes_m: Float | None = None,
    max_range_m: float = np.inf,
) -> MapQuality:
    """The quality of a map (N, 3) in the world frame.

    eyes_m (K, 3): where the sensor was, in the world. What could be seen is the surface within `max_range_m` of one of
    them, facing it, with no other steel between; the sensor's field of view does not count. Without eyes it is all the
    outer surface within the map's bounding box grown by 5 cm. `rng` draws the samples of the surface.

    Raises:
        ValueError: no points, a structure without shapes, or one with a shape that is not on its root link.
    """
    points_m = points_world_m.astype(np.float64)
    distances_m = distances_to_structure(points_m, structure)
    samples = _visible(points_m, TrueSurface(structure.shapes), rng, eyes_m, max_range_m)
    accuracy = accuracy_of(distances_m)
    if len(samples.points_m) == 0:
        return MapQuality(distances_m, accuracy, None, None, None)
    missed_m = distances_to_map(samples.points_m, points_m)
    completeness = {threshold: float((missed_m <= threshold).mean()) for threshold in THRESHOLDS_M}
    precision = {threshold: float((distances_m <= threshold).mean()) for threshold in THRESHOLDS_M}
    fscore = {threshold: _harmonic(precision[threshold], completeness[threshold]) for threshold in THRESHOLDS_M}
    return MapQuality(distances_m, accuracy, completeness, fscore, (accuracy.mean_m + float(missed_m.mean())) / 2)


def _visible(
    points_m: Float, surface: TrueSurface, rng: np.random.Generator, eyes_m: Float | None, max_range_m: float
) -> SurfaceSamples:
    if eyes_m is None:
        return surface.near(points_m.min(axis=0) - _GROWTH_M, points_m.max(axis=0) + _GROWTH_M, NUM_SAMPLES, rng)
    low_m, high_m = eyes_m.min(axis=0) - max_range_m, eyes_m.max(axis=0) + max_range_m
    samples = surface.near(low_m, high_m, NUM_SAMPLES, rng)
    return samples.where(surface.is_seen(samples, eyes_m, max_range_m))


def _harmonic(a: float, b: float) -> float:
    return 2 * a * b / (a + b) if a + b > 0 else 0.0
