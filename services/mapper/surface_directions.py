"""Which ways the surfaces of a cloud face, and the rotations that turn those of one cloud to those of another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_MAX_DIRECTIONS = 6
_MAX_SEEDS = 300
_CLUSTER_COSINE = np.cos(np.deg2rad(12.0))
_SEPARATION_COSINE = np.cos(np.deg2rad(24.0))
_MIN_SHARE = 0.04
"""A direction is one when so many of the normals are near it."""
_MAX_ANGLE_ERROR_RAD = np.deg2rad(8.0)
"""By so much the angles between two directions may differ in both clouds."""
_MIN_PAIR_SINE = np.sin(np.deg2rad(25.0))
_SAME_ROTATION_TRACE = 1.0 + 2.0 * np.cos(np.deg2rad(8.0))


@dataclass(frozen=True, slots=True, eq=False)
class Directions:
    """axes (K, 3): unit vectors, without sign, the one with the most normals first. shares (K,): of the normals."""

    axes: Float
    shares: Float


def surface_directions(normals: Float) -> Directions:
    """The directions about which unit normals (N, 3) crowd; zero normals belong to none."""
    left = normals[np.linalg.norm(normals, axis=1) > 0.5]
    axes: list[Float] = []
    shares: list[float] = []
    while len(axes) < _MAX_DIRECTIONS and len(left):
        seeds = left[:: max(1, len(left) // _MAX_SEEDS)]
        num_near = (np.abs(left @ seeds.T) > _CLUSTER_COSINE).sum(axis=0)
        axis = seeds[num_near.argmax()]
        for _ in range(2):
            axis = _mean_axis(left[np.abs(left @ axis) > _CLUSTER_COSINE])
        share = np.count_nonzero(np.abs(left @ axis) > _CLUSTER_COSINE) / len(normals)
        if share < _MIN_SHARE:
            break
        axes.append(axis)
        shares.append(share)
        left = left[np.abs(left @ axis) < _SEPARATION_COSINE]
    return Directions(np.array(axes).reshape(-1, 3), np.array(shares))


def rotations_between(source: Directions, target: Directions) -> list[Float]:
    """Each distinct R_target_source (3, 3) that turns two directions of the source to two of the target.

    The ones that turn the most of the source's surfaces to directions of the target come first.
    """
    found: list[tuple[float, Float]] = []
    for R in _turns_of_pairs(source.axes, target.axes):
        R, share = _fitted(R, source, target)
        if not any(np.trace(R.T @ other) > _SAME_ROTATION_TRACE for _, other in found):
            found.append((share, R))
    found.sort(key=lambda pair: -pair[0])
    return [R for _, R in found]


def _mean_axis(normals: Float) -> Float:
    """The unit vector to which normals without sign are nearest in the mean square."""
    axis: Float = np.linalg.eigh(normals.T @ normals)[1][:, 2]
    return axis


def _turns_of_pairs(source: Float, target: Float) -> Iterator[Float]:
    for i, j in permutations(range(len(source)), 2):
        angle = np.arccos(np.clip(source[i] @ source[j], -1.0, 1.0))
        for k, m in permutations(range(len(target)), 2):
            for sign in (1.0, -1.0):
                other = np.arccos(np.clip(sign * (target[k] @ target[m]), -1.0, 1.0))
                if i < j and abs(angle - other) < _MAX_ANGLE_ERROR_RAD and np.sin(angle) > _MIN_PAIR_SINE:
                    for way in (1.0, -1.0):
                        yield _frame(way * target[k], way * sign * target[m]) @ _frame(source[i], source[j]).T


def _frame(first: Float, second: Float) -> Float:
    """A rotation (3, 3) whose x is `first`, and whose y lies in the plane of both."""
    z = np.cross(first, second)
    z /= np.linalg.norm(z)
    return np.column_stack([first, np.cross(z, first), z])


def _fitted(R: Float, source: Directions, target: Directions) -> tuple[Float, float]:
    """The rotation fitted to all directions which it brings together (Kabsch 1976), and their share of the source."""
    cosines = target.axes @ R @ source.axes.T
    nearest = np.abs(cosines).argmax(axis=0)
    best = cosines[nearest, np.arange(len(source.axes))]
    weights = source.shares * (np.abs(best) > _CLUSTER_COSINE)
    pairs = (target.axes[nearest] * (np.sign(best) * weights)[:, np.newaxis]).T @ source.axes
    U, _, Vt = np.linalg.svd(pairs)
    fitted: Float = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return fitted, float(weights.sum())
