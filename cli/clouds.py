"""Clouds of files for commands, with what the user should know of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared.cloud_files import read_cloud, unit_warning
from shared.errors import CloudFileError

Float = NDArray[np.float64]


def finite_points(path: Path, warn: Callable[[str], None]) -> Float:
    """The finite points (N, 3) of a cloud file; those that are not, and what looks like millimetres, are told.

    Raises:
        InputFileError: there is no such file. CloudFileError: its content cannot be used, or has no finite point.
    """
    points_m = read_cloud(path).points_m
    is_finite: NDArray[np.bool_] = np.all(np.isfinite(points_m), axis=1)
    if not is_finite.any():
        raise CloudFileError(f"{path}: has no points" + (" that are finite" if len(points_m) else ""))
    if num_bad := int((~is_finite).sum()):
        warn(f"{path}: {num_bad} of {len(points_m)} points are not finite and are left out")
    if text := unit_warning(points_m):
        warn(f"{path}: {text}")
    return points_m[is_finite]
