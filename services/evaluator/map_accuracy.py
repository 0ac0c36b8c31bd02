"""How far a map's points are from the true structure, and how many lie off its main planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry import SE3
from shared.robot.description import UrdfModel
from shared.solids import Box

_RANSAC_ITERATIONS = 1000
"""As in the published evaluation of the original system : 11 planes, 0.04 m, 1000 iterations."""


@dataclass(frozen=True, slots=True)
class MapAccuracy:
    """Distances of map points to the nearest true surface."""

    num_points: int
    mean_m: float
    rmse_m: float
    p95_m: float
    max_m: float


def map_accuracy(points_world_m: NDArray[np.floating], structure: UrdfModel) -> MapAccuracy:
    """Accuracy of points (N, 3) in the world frame against the boxes of the structure.

    Raises:
        ValueError: no points, or a structure that is not made of boxes on its root link.
    """
    if len(points_world_m) == 0:
        raise ValueError("the map has no points")
    distances = np.full(len(points_world_m), np.inf)
    for shape in structure.shapes:
        if not isinstance(shape.solid, Box) or shape.link != structure.root:
            raise ValueError(f"{shape.link}: only boxes on the root link can be compared with")
        box_distances = distances_to_box(points_world_m, shape.solid, shape.T_link_shape)
        np.minimum(distances, box_distances, out=distances)
    return MapAccuracy(
        num_points=len(points_world_m),
        mean_m=float(distances.mean()),
        rmse_m=float(np.sqrt(np.mean(distances**2))),
        p95_m=float(np.percentile(distances, 95)),
        max_m=float(distances.max()),
    )


def distances_to_box(points_m: NDArray[np.floating], box: Box, T_world_box: SE3) -> NDArray[np.float64]:
    """Unsigned distances (N,) of points (N, 3) to the surface of a box, inside and outside."""
    local = np.abs(T_world_box.inv().apply(points_m.astype(np.float64))) - np.array(box.size_m) / 2
    outside = np.linalg.norm(np.maximum(local, 0.0), axis=1)
    inside = np.minimum(local.max(axis=1), 0.0)
    distances: NDArray[np.float64] = np.abs(outside + inside)
    return distances


def num_points_off_planes(points_m: NDArray[np.floating], *, num_planes: int, distance_m: float, seed: int) -> int:
    """Points left after the largest plane was taken away `num_planes` times: the published measure of a map's error.

    A plane takes what is within `distance_m` of it, after it was fitted to the inliers of the best sample. The figure
    reads 0 at centimetres of drift, so it says something only beside the accuracy. `seed` fixes the sampling.
    """
    import open3d as o3d

    o3d.utility.random.seed(seed)
    left_m = points_m.astype(np.float64)
    for _ in range(num_planes):
        if len(left_m) < 3:
            break
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(left_m))
        plane, _ = cloud.segment_plane(distance_m, ransac_n=3, num_iterations=_RANSAC_ITERATIONS)
        left_m = left_m[np.abs(left_m @ plane[:3] + plane[3]) > distance_m]
    return len(left_m)
