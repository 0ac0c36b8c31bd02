"""How an estimated trajectory is laid on the true one before the two are compared."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from shared.geometry import SE3

_MIN_SPREAD = 1e-6
"""Of the positions across their main direction, relative to that along it: below they lie on a line."""


class Alignment(StrEnum):
    """first: the first poses coincide, so drift shows. umeyama: least squares over all positions. none: as they are."""

    FIRST = "first"
    UMEYAMA = "umeyama"
    NONE = "none"


def aligned(alignment: Alignment, T_map_lidar: Sequence[SE3], T_world_lidar: Sequence[SE3]) -> SE3:
    """T_world_map that lays the estimate on the truth, pose k on pose k.

    Raises:
        ValueError: no poses, or umeyama with positions that lie on a line.
    """
    if not T_map_lidar:
        raise ValueError("no poses to align")
    if alignment is Alignment.FIRST:
        return T_world_lidar[0] @ T_map_lidar[0].inv()
    if alignment is Alignment.UMEYAMA:
        positions = [np.array([pose.translation for pose in poses]) for poses in (T_map_lidar, T_world_lidar)]
        return umeyama(*positions)
    return SE3.identity()


def umeyama(points_a_m: NDArray[np.float64], points_b_m: NDArray[np.float64]) -> SE3:
    """T_b_a that takes points (N, 3) nearest to their partners (N, 3) in the least squares, without change of scale.

    Raises:
        ValueError: the points lie on a line or in a point, which leaves a turn open.
    Source: Umeyama, IEEE TPAMI 13 (1991), equations 34 to 43.
    """
    middle_a, middle_b = points_a_m.mean(axis=0), points_b_m.mean(axis=0)
    U, spreads, Vt = np.linalg.svd((points_b_m - middle_b).T @ (points_a_m - middle_a))
    if not spreads[1] > _MIN_SPREAD * spreads[0]:
        raise ValueError("the positions lie on a line: umeyama leaves a turn about it open, align the first poses")
    signs = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    R = U @ signs @ Vt
    return SE3(R, middle_b - R @ middle_a)
