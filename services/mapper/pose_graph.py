"""Poses from relative poses between them, some of which may be wrong: Gauss-Newton with graduated weights.

Sources: Grisetti et al., "A tutorial on graph-based SLAM", ITS Magazine 2010; Yang et al., "Graduated non-convexity for
robust spatial perception", RA-L 2020.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry import SE3

Float = NDArray[np.float64]

_OUTLIER_DEVIATIONS = 5.0
_GRADUATION = 1.5
_MAX_ITERATIONS = 100
_MIN_STEP = 1e-6


@dataclass(frozen=True, slots=True)
class Edge:
    """T_first_second as it was measured, between the poses of these numbers; standard deviations along each axis.

    is_sure: it is taken at its full weight. Others lose theirs as they disagree with the rest.
    """

    first: int
    second: int
    T_first_second: SE3
    sigma_m: float
    sigma_rad: float
    is_sure: bool


@dataclass(frozen=True, slots=True, eq=False)
class OptimisedGraph:
    """T_map_pose: in the order of the poses. weights (E,): 0..1 for each edge, near 0 where it was found wrong."""

    T_map_pose: list[SE3]
    weights: Float


def optimised(T_map_pose: Sequence[SE3], edges: Sequence[Edge]) -> OptimisedGraph:
    """The poses that fit the edges best; the first pose stays. Dense, for up to about a thousand poses.

    Every pose must be joined to the first one by sure edges.
    """
    poses = list(T_map_pose)
    whitening = np.array([np.repeat([1.0 / edge.sigma_m, 1.0 / edge.sigma_rad], 3) for edge in edges]).reshape(-1, 6)
    is_sure = np.array([edge.is_sure for edge in edges], dtype=np.bool_)
    squares = _squares(poses, edges, whitening)
    tolerance = float(max(np.max(squares, initial=0.0, where=~is_sure) * 2.0, _OUTLIER_DEVIATIONS**2))
    weights = np.ones(len(edges))
    for _ in range(_MAX_ITERATIONS):
        weights = np.where(is_sure, 1.0, (tolerance / (tolerance + squares)) ** 2)
        step = _step(poses, edges, whitening * np.sqrt(weights)[:, np.newaxis])
        poses = [T @ SE3.exp(twist) for T, twist in zip(poses, step, strict=True)]
        squares = _squares(poses, edges, whitening)
        is_strict = tolerance <= _OUTLIER_DEVIATIONS**2
        if is_strict and np.abs(step).max(initial=0.0) < _MIN_STEP:
            break
        tolerance = max(tolerance / _GRADUATION, _OUTLIER_DEVIATIONS**2)
    return OptimisedGraph([SE3.projected(T.matrix) for T in poses], weights)


def _error(poses: Sequence[SE3], edge: Edge) -> Float:
    """The twist (6,) that is between the edge as measured and as the poses have it."""
    return (edge.T_first_second.inv() @ poses[edge.first].inv() @ poses[edge.second]).log()


def _squares(poses: Sequence[SE3], edges: Sequence[Edge], whitening: Float) -> Float:
    errors = np.array([_error(poses, edge) for edge in edges]).reshape(-1, 6)
    squares: Float = np.sum((errors * whitening) ** 2, axis=1)
    return squares


def _step(poses: Sequence[SE3], edges: Sequence[Edge], whitening: Float) -> Float:
    """A twist (6,) a pose, to be put on its right; that of the first one is 0."""
    num = 6 * len(poses)
    H, g = np.zeros((num, num)), np.zeros(num)
    for edge, white in zip(edges, whitening, strict=True):
        back = -_adjoint(poses[edge.second].inv() @ poses[edge.first])
        J = np.hstack([back, np.eye(6)]) * white[:, np.newaxis]
        at = np.r_[6 * edge.first : 6 * edge.first + 6, 6 * edge.second : 6 * edge.second + 6]
        H[np.ix_(at, at)] += J.T @ J
        g[at] += J.T @ (white * _error(poses, edge))
    step = np.zeros(num)
    step[6:] = -np.linalg.solve(H[6:, 6:], g[6:])
    return step.reshape(-1, 6)


def _adjoint(T: SE3) -> Float:
    """(6, 6): turns twists, translation first, from frame b into frame a of T_a_b."""
    x, y, z = T.translation
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[T.rotation, cross @ T.rotation], [np.zeros((3, 3)), T.rotation]])
