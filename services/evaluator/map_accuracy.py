"""How far a map's points are from the true structure, and how many lie off its main planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.cloud_planes import ransac_planes
from shared.geometry import SE3
from shared.meshes import merged, mesh_of
from shared.robot.description import Shape, UrdfModel
from shared.solids import Box, Mesh


@dataclass(frozen=True, slots=True)
class MapAccuracy:
    """Distances of map points to the nearest true surface."""

    num_points: int
    mean_m: float
    rmse_m: float
    p95_m: float
    max_m: float


def map_accuracy(points_world_m: NDArray[np.floating], structure: UrdfModel) -> MapAccuracy:
    """Accuracy of points (N, 3) in the world frame against the visible shapes of the structure.

    Boxes are compared with exactly; cylinders and spheres as the facets that the sensors see of them.

    Raises:
        ValueError: no points, or a structure with a shape that is not on its root link.
    """
    return accuracy_of(distances_to_structure(points_world_m, structure))


def distances_to_structure(points_world_m: NDArray[np.floating], structure: UrdfModel) -> NDArray[np.float64]:
    """Unsigned distances (N,) of points (N, 3) in the world frame to the nearest visible shape of the structure.

    Raises:
        ValueError: no points, or a structure with a shape that is not on its root link.
    """
    if len(points_world_m) == 0:
        raise ValueError("the map has no points")
    if far := [shape.link for shape in structure.shapes if shape.link != structure.root]:
        raise ValueError(f"{far[0]}: only shapes on the root link can be compared with")
    return distances_to_shapes(points_world_m.astype(np.float64), structure.shapes)


def accuracy_of(distances_m: NDArray[np.float64]) -> MapAccuracy:
    """The figures of distances (N,), of at least one point."""
    return MapAccuracy(
        num_points=len(distances_m),
        mean_m=float(distances_m.mean()),
        rmse_m=float(np.sqrt(np.mean(distances_m**2))),
        p95_m=float(np.percentile(distances_m, 95)),
        max_m=float(distances_m.max()),
    )


def distances_to_map(points_m: NDArray[np.float64], map_points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances (N,) of points (N, 3) to the nearest of the map's points (M, 3)."""
    o3d: Any = import_module("open3d")
    vectors, cloud = o3d.utility.Vector3dVector, o3d.geometry.PointCloud
    distances = cloud(vectors(points_m)).compute_point_cloud_distance(cloud(vectors(map_points_m)))
    return np.asarray(distances, dtype=np.float64)


def distances_to_shapes(points_m: NDArray[np.float64], shapes: Sequence[Shape]) -> NDArray[np.float64]:
    """Unsigned distances (N,) of points (N, 3) to the nearest surface of any shape; inf where there are no shapes."""
    others = [mesh_of(shape.solid).moved(shape.T_link_shape) for shape in shapes if not isinstance(shape.solid, Box)]
    distances = _distances_to_mesh(points_m, merged(others)) if others else np.full(len(points_m), np.inf)
    for shape in shapes:
        if isinstance(shape.solid, Box):
            from_centre = points_m - shape.T_link_shape.translation
            reach_m = distances + np.linalg.norm(shape.solid.size_m) / 2
            near = np.flatnonzero(np.einsum("ij,ij->i", from_centre, from_centre) < reach_m**2)
            if len(near) > 0:
                to_box = distances_to_box(points_m[near], shape.solid, shape.T_link_shape)
                distances[near] = np.minimum(distances[near], to_box)
    return distances


def _distances_to_mesh(points_m: NDArray[np.float64], mesh: Mesh) -> NDArray[np.float64]:
    """By Embree in float32, so from the mesh's middle: where structures are far from the origin nothing is lost."""
    o3d: Any = import_module("open3d")
    tensor, scene = o3d.core.Tensor, o3d.t.geometry.RaycastingScene(nthreads=1)
    middle = mesh.vertices_m.mean(axis=0)
    scene.add_triangles(tensor((mesh.vertices_m - middle).astype(np.float32)), tensor(mesh.triangles))
    distances = scene.compute_distance(tensor((points_m - middle).astype(np.float32)), nthreads=1)
    return np.asarray(distances.numpy(), dtype=np.float64)


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
    planes = ransac_planes(points_m, max_planes=num_planes, distance_m=distance_m, seed=seed)
    return len(points_m) - sum(len(plane.rows) for plane in planes)
