"""What of a scan is used at all: one pipeline, the same online and offline. It keeps the order of the points."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import small_gicp
from numpy.typing import NDArray

from services.mapper.registration import Points
from shared.kernel import lean_kernel
from shared.runtime.config import MapperConfig


class Verdict(IntEnum):
    """What became of a point: the first stage which it did not pass."""

    KEPT = 0
    NOT_FINITE = 1
    OUT_OF_RANGE = 2
    OUT_OF_BOX = 3
    ON_BODY = 4
    OUTLIER = 5


_NOT_FINITE, _OUT_OF_RANGE, _OUT_OF_BOX, _ON_BODY = (int(verdict) for verdict in list(Verdict)[1:5])
"""Plain integers for the kernel."""


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """points_m (M, 3): what is left, in the scan's order and float type. verdicts (N,): uint8, of every point."""

    points_m: Points
    verdicts: NDArray[np.uint8]

    @property
    def counts(self) -> dict[Verdict, int]:
        """How many points got each verdict."""
        counts = np.bincount(self.verdicts, minlength=len(Verdict)).tolist()
        return dict(zip(Verdict, counts, strict=True))


class ScanFilter:
    """Drops, in this order: what is not finite, out of range, out of the box, on the robot's body, far from others."""

    def __init__(self, config: MapperConfig) -> None:
        self._config = config
        self._box_m = np.array(config.crop_m or (-np.inf, np.inf) * 3).reshape(3, 2)

    def filtered(self, points_lidar_m: Points, is_body: NDArray[np.bool_] | None = None) -> Filtered:
        """The points (N, 3) that pass, in the sensor's frame. is_body (N,): which ones lie on the robot itself."""
        config = self._config
        points_m = np.ascontiguousarray(points_lidar_m)
        mask = np.zeros(0, dtype=np.bool_) if is_body is None else np.ascontiguousarray(is_body)
        verdicts = np.empty(len(points_m), dtype=np.uint8)
        kept_m = np.empty_like(points_m)
        num = _judge(points_m, mask, config.min_range_m**2, config.max_range_m**2, self._box_m, verdicts, kept_m)
        kept_m = kept_m[:num]
        if config.num_outlier_neighbours:
            is_outlier = outliers(kept_m, config.num_outlier_neighbours, config.outlier_deviations, config.num_threads)
            verdicts[np.flatnonzero(verdicts == Verdict.KEPT)[is_outlier]] = Verdict.OUTLIER
            kept_m = kept_m[~is_outlier]
        return Filtered(kept_m, verdicts)


def outliers(points_m: Points, num_neighbours: int, num_deviations: float, num_threads: int = 1) -> NDArray[np.bool_]:
    """Which of the points (N, 3) lie far from their nearest neighbours: (N,).

    Far: the mean distance to them is above the scan's mean of it by more than so many standard deviations. Clouds that
    have not enough points for that have no outliers.

    Source: Rusu et al., "Towards 3D point cloud based object maps for household environments", RAS 2008.
    """
    if len(points_m) <= num_neighbours:
        return np.zeros(len(points_m), dtype=np.bool_)
    tree = small_gicp.KdTree(points_m, num_threads)
    _, squares = tree.batch_knn_search(points_m, num_neighbours + 1, num_threads)
    means_m = np.sqrt(squares).sum(axis=1) / num_neighbours
    is_far: NDArray[np.bool_] = means_m > means_m.mean() + num_deviations * means_m.std()
    return is_far


@lean_kernel()
def _judge(
    points: Points,
    is_body: NDArray[np.bool_],
    min_square_m2: float,
    max_square_m2: float,
    box_m: NDArray[np.float64],
    verdicts: NDArray[np.uint8],
    kept: Points,
) -> int:
    """Fills in the verdicts and the points kept, and returns their number; an empty `is_body` is that of no point."""
    num = 0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        square_m2 = x * x + y * y + z * z
        if not np.isfinite(x + y + z):
            verdicts[i] = _NOT_FINITE
        elif not min_square_m2 <= square_m2 <= max_square_m2:
            verdicts[i] = _OUT_OF_RANGE
        elif not _is_inside(x, y, z, box_m):
            verdicts[i] = _OUT_OF_BOX
        elif len(is_body) and is_body[i]:
            verdicts[i] = _ON_BODY
        else:
            verdicts[i] = 0
            kept[num, 0], kept[num, 1], kept[num, 2] = x, y, z
            num += 1
    return num


@lean_kernel()
def _is_inside(x: float, y: float, z: float, box_m: NDArray[np.float64]) -> bool:
    return bool(box_m[0, 0] <= x <= box_m[0, 1] and box_m[1, 0] <= y <= box_m[1, 1] and box_m[2, 0] <= z <= box_m[2, 1])
