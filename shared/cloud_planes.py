"""The planes of a point cloud, the largest first: by RANSAC, or grown from where the surface is flat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Rows = NDArray[np.int64]

_RANSAC_ITERATIONS = 1000
"""As in the published evaluation of the original system: 11 planes, 0.04 m, 1000 iterations."""
_MAX_JUDGES = 10_000
_NUM_NEIGHBOURS = 12
_MIN_COSINE = np.cos(np.deg2rad(20.0))
"""Neighbours whose normals differ by more belong to different faces; noise turns normals by some 10 degrees."""
_THRESHOLDS_A_CELL = 3.0
"""Edge of the cells that connect a region: 0.12 m at a threshold of 0.04 m, below the bars' width."""
_MIN_REGION = 10
_STRIDES = np.array([1 << 42, 1 << 21, 1])
_AROUND = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3), axis=-1).reshape(-1, 3) @ _STRIDES


@dataclass(frozen=True, slots=True, eq=False)
class CloudPlane:
    """The plane n . p + d = 0 of `coefficients` (4,) n x y z of length 1 and d in metres; rows of its points (M,)."""

    coefficients: Float
    rows: Rows


def ransac_planes(points_m: NDArray[np.floating], *, max_planes: int, distance_m: float, seed: int) -> list[CloudPlane]:
    """The plane with the most points is taken away with all within `distance_m` of it, up to `max_planes` times.

    Samples are judged by at most `_MAX_JUDGES` of the points. Points (N, 3) must be finite. `seed` fixes the sampling.
    """
    o3d: Any = import_module("open3d")
    o3d.utility.random.seed(seed)
    rng = np.random.default_rng(seed)
    points_m = points_m.astype(np.float64)
    left = np.arange(len(points_m))
    planes: list[CloudPlane] = []
    while len(planes) < max_planes and len(left) >= 3:
        judges = left if len(left) <= _MAX_JUDGES else rng.choice(left, _MAX_JUDGES, replace=False)
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m[judges]))
        fitted, _ = cloud.segment_plane(distance_m, ransac_n=3, num_iterations=_RANSAC_ITERATIONS)
        plane = np.asarray(fitted, dtype=np.float64)
        is_on = np.abs(points_m[left] @ plane[:3] + plane[3]) <= distance_m
        if not is_on.any():
            break
        planes.append(CloudPlane(plane, left[is_on]))
        left = left[~is_on]
    return planes


def region_planes(points_m: NDArray[np.floating], *, max_planes: int, distance_m: float) -> list[CloudPlane]:
    """Connected flat regions, each on a plane of its own, so the faces of two bars in one plane are two.

    A region grows over neighbouring cells of a grid, through points within `distance_m` of the plane of its seed's
    neighbourhood whose normals are along its own; then its plane is fitted anew. Points (N, 3) must be finite.
    """
    points: Float = points_m.astype(np.float64)
    if len(points) < _MIN_REGION:
        return []
    normals, flatness = _normals(points)
    growth = _Growth(points, normals, distance_m)
    planes = [CloudPlane(_fitted(points[rows]), rows) for rows in growth.regions(np.argsort(flatness, kind="stable"))]
    planes.sort(key=lambda plane: -len(plane.rows))
    return planes[:max_planes]


METHODS: dict[str, Callable[[NDArray[np.floating], int, float, int], list[CloudPlane]]] = {
    "ransac": lambda points_m, max_planes, distance_m, seed: ransac_planes(
        points_m, max_planes=max_planes, distance_m=distance_m, seed=seed
    ),
    "region": lambda points_m, max_planes, distance_m, _: region_planes(
        points_m, max_planes=max_planes, distance_m=distance_m
    ),
}
"""By name: points (N, 3), how many planes at most, distance in metres, seed."""


class _Growth:
    """Takes regions out of a cloud; a cell of its grid is one integer, so a neighbour is a difference of integers."""

    def __init__(self, points_m: Float, normals: Float, distance_m: float) -> None:
        self._points_m, self._normals, self._distance_m = points_m, normals, distance_m
        self._free = np.arange(len(points_m))
        cells = np.floor(points_m / (_THRESHOLDS_A_CELL * distance_m)).astype(np.int64)
        self._cells = (cells - cells.min(axis=0) + 1) @ _STRIDES

    def regions(self, seeds: Rows) -> list[Rows]:
        """Regions of at least `_MIN_REGION` points, grown from each seed that is still free, in this order."""
        regions = []
        is_free = np.ones(len(self._points_m), dtype=bool)
        for seed in seeds.tolist():
            if not is_free[seed]:
                continue
            rows = self._grown(seed)
            is_free[seed] = False
            if len(rows) >= _MIN_REGION:
                regions.append(rows)
                is_free[rows] = False
                self._free = np.flatnonzero(is_free)
        return regions

    def _grown(self, seed: int) -> Rows:
        normal = self._normals[seed]
        rows = self._connected(seed, normal, float(normal @ self._points_m[seed]))
        if len(rows) < _MIN_REGION:
            return rows
        plane = _fitted(self._points_m[rows])
        return self._connected(seed, plane[:3], -float(plane[3]))

    def _connected(self, seed: int, normal: Float, offset_m: float) -> Rows:
        """The free points on a plane, with normals along its own, in cells that touch, beginning with the seed's."""
        is_near = np.abs(self._points_m[self._free] @ normal - offset_m) <= self._distance_m
        near = self._free[is_near]
        near = near[np.abs(self._normals[near] @ normal) >= _MIN_COSINE]
        occupied = set(self._cells[near].tolist())
        start = int(self._cells[seed])
        seen, waiting = {start}, [start]
        while waiting:
            fresh = occupied.intersection((_AROUND + waiting.pop()).tolist()) - seen
            seen |= fresh
            waiting += fresh
        connected: Rows = near[np.isin(self._cells[near], list(seen))]
        return connected


def _normals(points_m: Float) -> tuple[Float, Float]:
    """Unit normals (N, 3) of each point's nearest neighbours and how far from flat these are (N,), 0 = flat."""
    o3d: Any = import_module("open3d")
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m))
    cloud.estimate_covariances(o3d.geometry.KDTreeSearchParamKNN(_NUM_NEIGHBOURS))
    values, vectors = np.linalg.eigh(np.asarray(cloud.covariances))
    return vectors[:, :, 0], values[:, 0] / np.maximum(values.sum(axis=1), 1e-300)


def _fitted(points_m: Float) -> Float:
    """The plane of least squares (4,)."""
    middle = points_m.mean(axis=0)
    _, vectors = np.linalg.eigh((points_m - middle).T @ (points_m - middle))
    normal = vectors[:, 0]
    return np.append(normal, -normal @ middle)
