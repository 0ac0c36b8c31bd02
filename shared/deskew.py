"""Takes out of a scan the motion that the sensor made while it was taken."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.kernel import lean_kernel
from shared.messaging.messages import LidarScan
from shared.motion import Motion

_NUM_STEPS = 128
"""A scan's time is divided into so many steps, in which the sensor moves evenly: 0.8 ms of a revolution at 10 Hz."""

Float = NDArray[np.float64]


def deskewed(scan: LidarScan, motion: Motion, at_ns: int | None = None) -> NDArray[np.float32]:
    """The points (N, 3) of a scan in the sensor's frame as it stood at `at_ns`, by default the scan's own stamp.

    motion: of the sensor alone, T_fixed_sensor in any frame that does not move, over the time of the scan.
    """
    if len(scan.points_m) == 0:
        return scan.points_m
    end_ns = scan.stamp_ns if at_ns is None else at_ns
    step_ns = max(-(-int(scan.t_ns.max()) // _NUM_STEPS), 1)
    moments_ns = scan.stamp_ns + step_ns * np.arange(_NUM_STEPS + 2, dtype=np.int64)
    rotations, translations_m = motion.at(np.append(moments_ns, end_ns))
    R, t = rotations[:, 0], translations_m[:, 0]
    straight = np.empty(scan.points_m.shape, dtype=np.float32)
    to_end, shift_m = R[-1].T @ R[:-1], (t[:-1] - t[-1]) @ R[-1]
    _straighten(scan.points_m, scan.t_ns, np.ascontiguousarray(to_end), shift_m, float(step_ns), straight)
    return straight


@lean_kernel()
def _straighten(
    points: NDArray[np.float32],
    t_ns: NDArray[np.uint32],
    rotations: Float,
    shifts: Float,
    step_ns: float,
    straight: NDArray[np.float32],
) -> None:
    """Each point moved by the pose of its time: between two moments, the mean of theirs weighted by nearness."""
    for i in range(len(points)):
        position = t_ns[i] / step_ns
        k = int(position)
        b = position - k
        a = 1.0 - b
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for row in range(3):
            before = rotations[k, row, 0] * x + rotations[k, row, 1] * y + rotations[k, row, 2] * z + shifts[k, row]
            R, t = rotations[k + 1], shifts[k + 1]
            after = R[row, 0] * x + R[row, 1] * y + R[row, 2] * z + t[row]
            straight[i, row] = a * before + b * after
