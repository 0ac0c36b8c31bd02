"""Mean map entropy: how crisp a map is, without any truth."""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_MIN_NEIGHBOURS = 5
_FLOOR_M = 1e-4
"""Added to every standard deviation's square, so that a surface without noise has a finite entropy."""
_CHUNK = 100
_ENTROPY_CONSTANT = 0.5 * 3 * math.log(2 * math.pi * math.e)


def mean_map_entropy(
    points_m: NDArray[np.floating], *, radius_m: float, max_queries: int, rng: np.random.Generator
) -> float | None:
    """Mean over points of 1/2 ln|2 pi e S|, S the covariance of all points within `radius_m`; metres, nats.

    At most `max_queries` of the points (N, 3), drawn by `rng`, are asked, each with all its neighbours. Points with
    less than five neighbours do not count; None where none is left. Less is crisper.

    Source: Razlaw, Droeschel, Holz, Behnke, ECMR 2015, equations 10 and 11.
    """
    points: Float = points_m.astype(np.float64)
    if len(points) < _MIN_NEIGHBOURS:
        return None
    queries = points
    if len(points) > max_queries:
        queries = points[np.sort(rng.choice(len(points), max_queries, replace=False))]
    entropies = np.concatenate(_entropies(points, queries, radius_m))
    return float(entropies.mean()) if len(entropies) else None


def _entropies(points_m: Float, queries: Float, radius_m: float) -> list[Float]:
    o3d: Any = import_module("open3d")
    search = o3d.core.nns.NearestNeighborSearch(o3d.core.Tensor(points_m))
    search.fixed_radius_index(radius_m)
    found = []
    for start in range(0, len(queries), _CHUNK):
        chunk = queries[start : start + _CHUNK]
        rows, _, splits = search.fixed_radius_search(o3d.core.Tensor(chunk), radius_m)
        found.append(_entropies_of(points_m[rows.numpy()], chunk, splits.numpy()))
    return found


def _entropies_of(neighbours_m: Float, queries: Float, splits: NDArray[np.int64]) -> Float:
    """One a query that has enough neighbours; those of query k are rows splits[k] to splits[k + 1]."""
    counts = np.diff(splits)
    local = neighbours_m - np.repeat(queries, counts, axis=0)  # about the query: no digits are lost far away
    starts, counts = splits[:-1][counts >= _MIN_NEIGHBOURS], counts[counts >= _MIN_NEIGHBOURS]
    if len(starts) == 0:
        return np.empty(0)
    columns = np.concatenate([local, (local[:, :, np.newaxis] * local[:, np.newaxis]).reshape(-1, 9)], axis=1)
    ends = starts + counts
    sums = np.concatenate([np.zeros((1, 12)), np.cumsum(columns, axis=0)])
    means = (sums[ends] - sums[starts]) / counts[:, np.newaxis]
    middles = means[:, :3]
    covariances = means[:, 3:].reshape(-1, 3, 3) - middles[:, :, np.newaxis] * middles[:, np.newaxis]
    _, logarithms = np.linalg.slogdet(covariances + _FLOOR_M**2 * np.eye(3))
    entropies: Float = _ENTROPY_CONSTANT + 0.5 * logarithms
    return entropies
