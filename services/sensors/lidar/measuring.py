"""The LiDAR's measurement as kernels over all beams: the arithmetic behind `effects`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.sensors.noise_hash import hash64, normal_of, uniform_of
from shared.kernel import kernel

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]

_MAX_INTENSITY = np.float32(255.0)


@kernel(inline="always")
def _visibility(cosine: float, surface: Floats) -> float:
    """The chance that a surface sends light back at this incidence: 1, falling to 0 over the fading angle."""
    if cosine >= surface[1]:
        return 1.0
    angle = math.acos(cosine)
    return 0.0 if angle >= surface[3] else (surface[3] - angle) / (surface[3] - surface[2])


@kernel()
def mixed_returns(
    cells: NDArray[np.int64],
    sub_range_m: Floats,
    sub_face: Ints,
    sub_cos: Floats,
    surfaces: Floats,
    pulse_m: float,
    range_m: Floats,
    true_range_m: Floats,
    face: Ints,
    brightness: Floats,
) -> None:
    """Puts into the cells near edges what their sub-rays say together.

    Sub-rays whose surfaces lie within a pulse of the nearest of them make one return; the strongest return counts. Its
    range is the mean weighted by signal, brightness the reflectivity and cosine averaged over all sub-rays.
    """
    num_sub_rays = sub_range_m.shape[1]
    weights, signals = np.empty(num_sub_rays), np.empty(num_sub_rays)
    for e in range(len(cells)):
        for k in range(num_sub_rays):
            weights[k] = signals[k] = 0.0
            if sub_face[e, k] >= 0:
                surface = surfaces[sub_face[e, k]]
                weights[k] = surface[0] * sub_cos[e, k] * _visibility(sub_cos[e, k], surface)
                signals[k] = weights[k] / (sub_range_m[e, k] * sub_range_m[e, k])
        first, mean_m, sum_of_weights = _strongest(sub_range_m[e], weights, signals, pulse_m)
        c, r = divmod(cells[e], range_m.shape[1])
        if first < 0:
            range_m[c, r], face[c, r] = np.inf, -1
        else:
            range_m[c, r], true_range_m[c, r], face[c, r] = mean_m, sub_range_m[e, first], sub_face[e, first]
            brightness[c, r] = sum_of_weights / num_sub_rays


@kernel()
def _strongest(
    range_m: Floats, weights: NDArray[np.float64], signals: NDArray[np.float64], pulse_m: float
) -> tuple[int, float, float]:
    """Of the return with the largest signal: its nearest sub-ray (-1: there is none), mean range, sum of weights."""
    best, best_signal, best_mean, best_weight = -1, 0.0, 0.0, 0.0
    for first in range(len(weights)):
        signal = moment = total = 0.0
        for k in range(len(weights)):
            if signals[k] > 0.0 and 0.0 <= range_m[k] - range_m[first] <= pulse_m:
                signal += signals[k]
                moment += signals[k] * range_m[k]
                total += weights[k]
        if signals[first] > 0.0 and signal > best_signal:
            best, best_signal, best_mean, best_weight = first, signal, moment / signal, total
    return best, best_mean, best_weight


@kernel()
def measured_ranges(
    range_m: Floats,
    face: Ints,
    cos_incidence: Floats,
    brightness: Floats,
    surfaces: Floats,
    is_filtered: NDArray[np.bool_],
    detection: NDArray[np.float64],
    noise_m: NDArray[np.float64],
    gate_m: NDArray[np.float64],
    seed: np.uint64,
    stamp: int,
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Measured ranges (C, R), -1 where nothing is reported, intensities (C, R), and returns a ring (R,).

    brightness (C, R): NaN where it follows from the face. detection: signal at which half the beams return, steepness,
    and the weakness up to which all do. noise_m: on strong signals, on weak ones, quantum. gate_m: least and greatest
    range from the axis, and the beams' distance from it.
    """
    num_columns, num_rings = range_m.shape
    measured = np.full(range_m.shape, np.float32(-1.0))
    intensity = np.empty(range_m.shape, dtype=np.float32)
    counts = np.zeros(num_rings, dtype=np.int64)
    key = hash64(seed, 0, stamp)
    strong_m2, weak_m2 = noise_m[0] ** 2, noise_m[1] ** 2
    quantum_m, steps_per_m = noise_m[2], 1.0 / noise_m[2]
    for c in range(num_columns):
        for r in range(num_rings):
            k = face[c, r]
            if k < 0 or is_filtered[k]:
                continue
            value, bright, chance = range_m[c, r] + gate_m[2], float(brightness[c, r]), 1.0
            if math.isnan(bright):
                bright = surfaces[k, 0] * cos_incidence[c, r]
                chance = _visibility(cos_incidence[c, r], surfaces[k])
            weakness = detection[0] * value * value / bright
            if weakness > detection[2]:
                chance *= _detection_chance(weakness, detection[1])
            bits = hash64(key, 0, c * num_rings + r)
            if chance < 1.0 and uniform_of(bits) >= chance:
                continue
            value += math.sqrt(strong_m2 + weak_m2 * weakness) * normal_of(bits)
            if quantum_m > 0.0:
                value = quantum_m * np.rint(value * steps_per_m)
            if gate_m[0] <= value <= gate_m[1]:
                measured[c, r] = value - gate_m[2]
                intensity[c, r] = _MAX_INTENSITY * bright
                counts[r] += 1
    return measured, intensity, counts


@kernel(inline="always")
def _detection_chance(weakness: float, steepness: float) -> float:
    """s^k / (1 + s^k) of the strength s = 1 / weakness, the signal over that at which half the beams return."""
    return 1.0 / (1.0 + math.exp(steepness * math.log(weakness)))


@kernel()
def packed(
    measured_m: Floats,
    intensity: Floats,
    counts: NDArray[np.int64],
    face: Ints,
    true_range_m: Floats,
    origins_m: Floats,
    rotations: Floats,
    directions: Floats,
    with_truth: bool,
) -> tuple[Any, ...]:
    """The returns ring by ring: points (N, 3), column, ring, intensity, face, true range; the last two (0,) untold.

    origins_m (C, 3), rotations (C, 3, 3), directions (R, 3): see `Beams`.
    """
    num_columns, num_rings = measured_m.shape
    starts = np.cumsum(counts) - counts
    total = counts.sum()
    points_m, column, ring = np.empty((total, 3), np.float32), np.empty(total, np.int32), np.empty(total, np.uint16)
    brightness, num_told = np.empty(total, np.float32), total if with_truth else 0
    faces, truth_m = np.empty(num_told, np.int32), np.empty(num_told, np.float32)
    for c in range(num_columns):
        for r in range(num_rings):
            if measured_m[c, r] == -1.0:
                continue
            i = starts[r]
            starts[r] += 1
            x, y, z = directions[r, 0], directions[r, 1], directions[r, 2]
            for axis in range(3):
                along = rotations[c, axis, 0] * x + rotations[c, axis, 1] * y + rotations[c, axis, 2] * z
                points_m[i, axis] = origins_m[c, axis] + measured_m[c, r] * along
            column[i], ring[i], brightness[i] = c, r, intensity[c, r]
            if with_truth:
                faces[i], truth_m[i] = face[c, r], true_range_m[c, r]
    return points_m, column, ring, brightness, faces, truth_m
