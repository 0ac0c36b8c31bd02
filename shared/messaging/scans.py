"""Points as the scans that the mapper takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.messaging.messages import LidarScan


def scan_of(
    points_m: NDArray[np.floating],
    stamp_ns: int,
    seq: int = 0,
    *,
    frame: str = "lidar",
    t_ns: NDArray[np.integer] | None = None,
) -> LidarScan:
    """A scan of these points (N, 3) in metres, in the sensor's frame.

    t_ns (N,): after the stamp, when each was measured; None: all at once. Points that are not finite are left out.
    """
    is_point: NDArray[np.bool_] = np.all(np.isfinite(points_m), axis=1)
    num = int(np.count_nonzero(is_point))
    return LidarScan(
        stamp_ns=stamp_ns,
        seq=seq,
        frame=frame,
        points_m=points_m[is_point].astype(np.float32),
        intensity=np.zeros(num, dtype=np.float32),
        t_ns=np.zeros(num, dtype=np.uint32) if t_ns is None else t_ns[is_point].astype(np.uint32),
        ring=np.zeros(num, dtype=np.uint16),
    )
