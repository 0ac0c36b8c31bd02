"""Thins a cloud by the mapper's own filters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.mapper.filters import ScanFilter, Verdict
from services.mapper.voxel_map import voxel_centroids
from shared.runtime.config import MapperConfig

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FilterSteps:
    """What is dropped, None = nothing of it. outliers: number of neighbours, and of standard deviations."""

    range_m: tuple[float, float] | None = None
    crop_m: tuple[float, float, float, float, float, float] | None = None
    outliers: tuple[int, float] | None = None
    voxel_m: float | None = None


def filtered_cloud(points_m: Float, steps: FilterSteps) -> tuple[Float, dict[Verdict, int]]:
    """The points (M, 3) that are left, always finite ones, and how many went and stayed by verdict before the voxels.

    Raises:
        ValueError: points are too far away for voxels so small.
    """
    low_m, high_m = steps.range_m or (0.0, math.inf)
    changes: dict[str, Any] = {"min_range_m": low_m, "max_range_m": high_m, "crop_m": steps.crop_m}
    if steps.outliers is not None:
        changes |= {"num_outlier_neighbours": steps.outliers[0], "outlier_deviations": steps.outliers[1]}
    judged = ScanFilter(MapperConfig(num_outlier_neighbours=0).model_copy(update=changes)).filtered(points_m)
    left_m: Float = judged.points_m.astype(np.float64)
    if steps.voxel_m is not None:
        left_m = voxel_centroids(left_m, steps.voxel_m)
    return left_m, judged.counts
