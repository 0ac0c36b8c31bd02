"""The target of a registration: points with normals, searched by a kd-tree, and how well a scan lies on them."""

from __future__ import annotations

import numpy as np
import small_gicp
from numpy.typing import NDArray

from services.mapper.registration import (
    MIN_POINTS,
    Points,
    RegistrationError,
    RegistrationResult,
    nothing_found,
    surface_score,
)
from shared.geometry import SE3
from shared.kernel import kernel

NUM_NEIGHBOURS = 10
"""From which a point's local shape is estimated, as small_gicp's own preprocessing does."""

_NUM_ROUGHNESS_POINTS = 1000
_TOLERANCE_ROUGHNESS = 2.0
"""Inliers count half that are off by so many times what neighbours in the target are off each other.

With range noise of 8 mm and 5 cm voxels that is 20 mm: good registrations have 6-8 mm, those slipped by 2, 5, 10 cm
have 11-13, 23-30, 28-50 mm. With 30 mm of noise it is 40 mm, and good registrations have 13-16 mm.
"""
_MIN_TOLERANCE_M, _MAX_TOLERANCE_M = 0.01, 0.05

Float = NDArray[np.float64]


class Surface:
    """Target points (M, 3) in the map frame.

    points_m, normals (M, 3): those points, and the directions of the surfaces there, up to sign. cloud: small_gicp's,
    with normals and local shapes (covariances). tree: its kd-tree.

    Raises:
        RegistrationError: fewer than MIN_POINTS points.
    """

    def __init__(self, points_map_m: Points, num_threads: int) -> None:
        if len(points_map_m) < MIN_POINTS:
            raise RegistrationError(f"the target has {len(points_map_m)} points; registration needs {MIN_POINTS}")
        self._num_threads = num_threads
        self.points_m = np.ascontiguousarray(points_map_m, dtype=np.float64)
        self.cloud = small_gicp.PointCloud(self.points_m)
        self.tree = small_gicp.KdTree(self.cloud, num_threads)
        small_gicp.estimate_normals_covariances(self.cloud, self.tree, NUM_NEIGHBOURS, num_threads)
        self.normals: Float = np.ascontiguousarray(self.cloud.normals()[:, :3])
        self._tolerance_m = float(
            np.clip(_TOLERANCE_ROUGHNESS * self._roughness_m(), _MIN_TOLERANCE_M, _MAX_TOLERANCE_M)
        )

    def nearest(self, points_map_m: Points) -> tuple[NDArray[np.uint64], Float]:
        """Index and squared distance (N,) of the target point nearest to each point (N, 3) in the map frame."""
        if not len(points_map_m):
            return np.empty(0, dtype=np.uint64), np.empty(0)
        indices, squares_m2 = self.tree.batch_knn_search(points_map_m, 1, self._num_threads)
        return indices[:, 0], squares_m2[:, 0]

    def distances(self, points_map_m: Points) -> Float:
        """Distance (N,) in metres from each point (N, 3) in the map frame to the nearest of the target."""
        return np.sqrt(self.nearest(points_map_m)[1])

    def fit(
        self,
        points_lidar_m: Points,
        T_map_lidar: SE3,
        max_correspondence_m: float,
        *,
        is_converged: bool = True,
        num_iterations: int = 0,
    ) -> RegistrationResult:
        """What is to be said of a scan (N, 3) at a pose: each point is compared with the target point nearest to it.

        sigma_m and the score are of the distances along the target's normals.
        """
        if not len(points_lidar_m):
            return nothing_found(0, T_map_lidar)
        points_map_m = np.asarray(T_map_lidar.apply(points_lidar_m), dtype=np.float64)
        nearest, squares_m2 = self.nearest(points_map_m)
        is_inlier = squares_m2 <= max_correspondence_m**2
        num_inliers = int(is_inlier.sum())
        if not num_inliers:
            return nothing_found(len(points_lidar_m), T_map_lidar)
        found = nearest[is_inlier]
        residual_m2, hessian = _normal_equations(
            points_map_m[is_inlier], T_map_lidar.translation, self.points_m[found], self.normals[found]
        )
        variance_m2 = residual_m2 / num_inliers
        return RegistrationResult(
            T_map_lidar=T_map_lidar,
            is_converged=is_converged,
            num_iterations=num_iterations,
            num_points=len(points_lidar_m),
            num_inliers=num_inliers,
            fitness_m2=float(squares_m2[is_inlier].mean()),
            score=surface_score(num_inliers, len(points_lidar_m), variance_m2, self._tolerance_m),
            hessian=hessian,
            sigma_m=float(np.sqrt(variance_m2)),
        )

    def _roughness_m(self) -> float:
        """Root mean square of how far points of the target lie off the plane through the nearest other one."""
        some_m = self.points_m[:: max(1, len(self.points_m) // _NUM_ROUGHNESS_POINTS)]
        neighbours = self.tree.batch_knn_search(some_m, 2, self._num_threads)[0][:, 1]
        offsets_m = np.einsum("ij,ij->i", self.normals[neighbours], some_m - self.points_m[neighbours])
        return float(np.sqrt(np.mean(offsets_m**2)))


@kernel()
def _normal_equations(points: Float, origin: Float, targets: Float, normals: Float) -> tuple[float, Float]:
    """The sum of squared distances along the normals, and the Hessian (6, 6) of half of it.

    A step of translation t, then rotation w about `origin`, changes a distance by n @ t + ((p - origin) x n) @ w.
    """
    total, hessian, row = 0.0, np.zeros((6, 6)), np.empty(6)
    for i in range(len(points)):
        n = normals[i]
        x, y, z = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        row[0], row[1], row[2] = n[0], n[1], n[2]
        row[3], row[4], row[5] = y * n[2] - z * n[1], z * n[0] - x * n[2], x * n[1] - y * n[0]
        distance = 0.0
        for axis in range(3):
            distance += n[axis] * (points[i, axis] - targets[i, axis])
        total += distance * distance
        for j in range(6):
            for k in range(6):
                hessian[j, k] += row[j] * row[k]
    return total, hessian
