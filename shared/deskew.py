"""Takes out of a scan the motion that the sensor made while it was taken."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.messaging.messages import LidarScan
from shared.motion import Motion


def deskewed(scan: LidarScan, motion: Motion, at_ns: int | None = None) -> NDArray[np.float32]:
    """The points (N, 3) of a scan in the sensor's frame as it stood at `at_ns`, by default the scan's own stamp.

    motion: of the sensor alone, T_fixed_sensor in any frame that does not move, over the time of the scan.
    """
    stamps_ns, moment = np.unique(scan.t_ns, return_inverse=True)
    end_ns = scan.stamp_ns if at_ns is None else at_ns
    rotations, translations_m = motion.at(np.append(scan.stamp_ns + stamps_ns.astype(np.int64), end_ns))
    R, t = rotations[:, 0], translations_m[:, 0]
    to_end = np.einsum("ji,njk->nik", R[-1], R[:-1])
    shift_m = (t[:-1] - t[-1]) @ R[-1]
    straight: NDArray[np.floating] = np.einsum("nij,nj->ni", to_end[moment], scan.points_m) + shift_m[moment]
    return straight.astype(np.float32)
