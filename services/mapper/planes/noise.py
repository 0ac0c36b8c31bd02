"""How noisy ranges are, found in one scan without a map: on a plane, three neighbouring rays predict one another.

Where a fan of rays meets a plane, 1/r is a cos(angle) + b sin(angle), so that with angles A and B between three
neighbours u1 sin B + u3 sin A - u2 sin(A + B) = 0, with u = 1/r: exactly, at any incidence, also across dropped rays.
What is left over is noise, or an edge.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from shared.kernel import lean_kernel

Float = NDArray[np.float64]

NUM_RANGE_BINS = 400
RANGE_BIN_M = 0.25
"""Noise is kept by ranges of so much; beyond the last, 100 m, it stays."""
_BINS_AN_OCTAVE = 2
_MAX_ANGLE_RAD = 0.06
"""Farther apart, two rays seldom meet the same face of a bar."""
_MIN_TRIPLES = 60
"""Fewer tell too little of a bin of ranges: the spread of the estimate is over 10 %."""
_MEDIAN_OF_NORMAL = 0.67449
_CLIP = 3.0
_CLIPPED_MEDIAN = 0.67252
"""Median of the absolute value of a normal variable within 3 standard deviations."""
DEFAULT_SIGMA_M = 0.01
"""Of a scan that tells nothing, like one in random order: between the sensors known here (3 to 30 mm)."""
_MIN_SIGMA_M = 0.001
"""Below it, float32 and the deskewing are the greater errors."""


@lean_kernel()
def range_bin(range_m: float) -> int:
    """Where in a table of NUM_RANGE_BINS a range is."""
    return min(int(range_m * (1.0 / RANGE_BIN_M)), NUM_RANGE_BINS - 1)


@lean_kernel()
def _range_and_angle(points_m: NDArray[np.floating], i: int, j: int) -> tuple[float, float]:
    """The range of point j, and the angle between the rays of i and j."""
    ax, ay, az = float(points_m[i, 0]), float(points_m[i, 1]), float(points_m[i, 2])
    bx, by, bz = float(points_m[j, 0]), float(points_m[j, 1]), float(points_m[j, 2])
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return math.sqrt(bx * bx + by * by + bz * bz), math.atan2(
        math.sqrt(cx * cx + cy * cy + cz * cz), ax * bx + ay * by + az * bz
    )


@lean_kernel()
def range_residuals(points_m: NDArray[np.floating], residuals_m: Float, ranges_m: Float) -> int:
    """Writes what each three successive points (N, 3) say of the noise of a range; returns how many could be used.

    residuals_m (N,): of the standard deviation of a range, where the three are on a plane. ranges_m (N,): of the
    middle ones.
    """
    num = 0
    for i in range(1, len(points_m) - 1):
        r2, A = _range_and_angle(points_m, i - 1, i)
        r3, B = _range_and_angle(points_m, i, i + 1)
        r1, both = _range_and_angle(points_m, i + 1, i - 1)
        if not (0.0 < A < _MAX_ANGLE_RAD and 0.0 < B < _MAX_ANGLE_RAD and abs(A + B - both) < 0.02 * both):
            continue
        if min(r1, r2, r3) <= 0.0:
            continue
        a, b, c = math.sin(B), math.sin(A), math.sin(A + B)
        left_over = a / r1 + b / r3 - c / r2
        spread = math.sqrt((a / (r1 * r1)) ** 2 + (b / (r3 * r3)) ** 2 + (c / (r2 * r2)) ** 2)
        residuals_m[num], ranges_m[num] = abs(left_over) / spread, r2
        num += 1
    return num


def sigma_by_range(points_lidar_m: NDArray[np.floating]) -> Float:
    """Standard deviation of a range (NUM_RANGE_BINS,) in metres, from a scan (N, 3) in the order of measurement.

    Ranges of which it tells too little take over what the nearest ones say; a scan that tells nothing gives
    DEFAULT_SIGMA_M.
    """
    residuals_m, ranges_m = np.empty(len(points_lidar_m)), np.empty(len(points_lidar_m))
    num = range_residuals(points_lidar_m, residuals_m, ranges_m)
    residuals_m, ranges_m = residuals_m[:num], ranges_m[:num]
    octaves = np.floor(_BINS_AN_OCTAVE * np.log2(np.maximum(ranges_m, RANGE_BIN_M)))
    known_m, sigmas_m = [], []
    for octave in np.unique(octaves):
        is_of_octave = octaves == octave
        if is_of_octave.sum() >= _MIN_TRIPLES:
            known_m.append(float(np.median(ranges_m[is_of_octave])))
            sigmas_m.append(robust_sigma(residuals_m[is_of_octave]))
    if not known_m:
        return np.full(NUM_RANGE_BINS, DEFAULT_SIGMA_M)
    centres_m = RANGE_BIN_M * (np.arange(NUM_RANGE_BINS) + 0.5)
    sigma_m: Float = np.maximum(np.interp(centres_m, known_m, sigmas_m), _MIN_SIGMA_M)
    return sigma_m


def robust_sigma(magnitudes: Float) -> float:
    """Standard deviation of a normal variable from its magnitudes (N,), of which some are outliers."""
    sigma = float(np.median(magnitudes)) / _MEDIAN_OF_NORMAL
    for _ in range(20):
        kept = magnitudes[magnitudes <= _CLIP * sigma]
        if not len(kept):
            break
        last, sigma = sigma, float(np.median(kept)) / _CLIPPED_MEDIAN
        if abs(last - sigma) < 1e-3 * last:
            break
    return sigma
