"""Points on the true surface of a structure, and which of them can be seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.meshes import is_closed, merged, mesh_of
from shared.robot.description import Shape
from shared.solids import Mesh

Float = NDArray[np.float64]

_OFF_M = 1e-4
"""How far above a surface one asks whether other steel lies on it."""
_TOLERANCE_M = 1e-3
"""A ray that ends so near to a point has met it: float32 and grazing rays need some room."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSamples:
    """points_m (N, 3) on a surface, normals (N, 3) of length 1 out of the steel."""

    points_m: Float
    normals: Float

    def where(self, is_kept: NDArray[np.bool_]) -> SurfaceSamples:
        """Those of a mask (N,)."""
        return SurfaceSamples(self.points_m[is_kept], self.normals[is_kept])


class TrueSurface:
    """All shapes of a structure as one mesh, cylinders and spheres as the facets that the sensors see of them."""

    def __init__(self, shapes: Sequence[Shape]) -> None:
        o3d: Any = import_module("open3d")
        solids = [shape.solid for shape in shapes]
        meshes = [mesh_of(shape.solid).moved(shape.T_link_shape) for shape in shapes]
        self._bodies = [(mesh, not isinstance(solid, Mesh)) for mesh, solid in zip(meshes, solids, strict=True)]
        self._mesh = merged(meshes)
        if len(self._mesh.triangles) == 0:
            raise ValueError("the structure has no shapes to compare a map with")
        self._tensor: Any = o3d.core.Tensor
        self._scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._middle = self._mesh.vertices_m.mean(axis=0)  # Embree has float32: far from the origin nothing is lost
        vertices = (self._mesh.vertices_m - self._middle).astype(np.float32)
        self._scene.add_triangles(self._tensor(vertices), self._tensor(np.ascontiguousarray(self._mesh.triangles)))

    def near(self, low_m: Float, high_m: Float, num_samples: int, rng: np.random.Generator) -> SurfaceSamples:
        """Samples evenly over the surface of the triangles that reach into a box, those outside of it left out.

        At most `num_samples`; of steel that lies in or flush on other steel nothing is left.
        """
        corners = self._mesh.vertices_m[self._mesh.triangles].astype(np.float64)
        reaches = (corners.min(axis=1) <= high_m).all(axis=1) & (corners.max(axis=1) >= low_m).all(axis=1)
        samples = _sampled(corners[reaches], num_samples, rng)
        is_inside: NDArray[np.bool_] = np.all((samples.points_m >= low_m) & (samples.points_m <= high_m), axis=1)
        samples = samples.where(is_inside)
        return samples.where(~self._is_buried(samples))

    def is_seen(self, samples: SurfaceSamples, eyes_m: Float, max_range_m: float) -> NDArray[np.bool_]:
        """Mask (N,): within range of one of the eyes (K, 3), its face towards it, nothing in between."""
        is_seen = np.zeros(len(samples.points_m), dtype=bool)
        for eye_m in eyes_m:
            rays = samples.points_m - eye_m
            ranges_m = np.linalg.norm(rays, axis=1)
            may_be = ~is_seen & (ranges_m <= max_range_m) & (np.einsum("ij,ij->i", rays, samples.normals) < 0)
            rows = np.flatnonzero(may_be)
            hits_m = self._cast(eye_m, rays[rows] / ranges_m[rows, np.newaxis])
            is_seen[rows] = hits_m >= ranges_m[rows] - _TOLERANCE_M
        return is_seen

    def _cast(self, eye_m: Float, directions: Float) -> Float:
        starts = np.broadcast_to(eye_m - self._middle, directions.shape)
        rays = np.concatenate([starts, directions], axis=1).astype(np.float32)
        hits_m: Float = self._scene.cast_rays(self._tensor(rays), nthreads=1)["t_hit"].numpy().astype(np.float64)
        return hits_m

    def _is_buried(self, samples: SurfaceSamples) -> NDArray[np.bool_]:
        """Mask (N,): just above them there is the inside of a shape."""
        above_m = samples.points_m + _OFF_M * samples.normals
        is_buried = np.zeros(len(above_m), dtype=bool)
        for mesh, is_convex in self._bodies:
            low_m, high_m = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
            near = np.flatnonzero(np.all((above_m >= low_m) & (above_m <= high_m), axis=1))
            if len(near):
                is_buried[near] |= _is_inside(above_m[near], mesh, is_convex=is_convex)
        return is_buried


def _is_inside(points_m: Float, mesh: Mesh, *, is_convex: bool) -> NDArray[np.bool_]:
    """Mask (N,); of a convex mesh by its planes, of another one if it is closed, by rays."""
    if is_convex:
        corners = mesh.vertices_m[mesh.triangles]
        normals, _ = _normals_and_areas(corners)
        is_behind: NDArray[np.bool_] = np.all(
            points_m @ normals.T <= np.einsum("ij,ij->i", normals, corners[:, 0]), axis=1
        )
        return is_behind
    if not is_closed(mesh):
        return np.zeros(len(points_m), dtype=bool)
    o3d: Any = import_module("open3d")
    scene, middle = o3d.t.geometry.RaycastingScene(nthreads=1), mesh.vertices_m.mean(axis=0)
    vertices = o3d.core.Tensor((mesh.vertices_m - middle).astype(np.float32))
    scene.add_triangles(vertices, o3d.core.Tensor(np.ascontiguousarray(mesh.triangles)))
    occupied: NDArray[np.bool_] = (
        scene.compute_occupancy(o3d.core.Tensor((points_m - middle).astype(np.float32))).numpy() > 0
    )
    return occupied


def _sampled(corners: Float, num_samples: int, rng: np.random.Generator) -> SurfaceSamples:
    """Evenly over the area of triangles (T, 3, 3), by Osada et al., ACM TOG 21 (2002), equation 1."""
    normals, areas = _normals_and_areas(corners)
    if not areas.sum() > 0:
        return SurfaceSamples(np.empty((0, 3)), np.empty((0, 3)))
    chosen = rng.choice(len(areas), num_samples, p=areas / areas.sum())
    root, share = np.sqrt(rng.random((num_samples, 1))), rng.random((num_samples, 1))
    a, b, c = np.moveaxis(corners[chosen], 1, 0)
    return SurfaceSamples((1 - root) * a + root * (1 - share) * b + root * share * c, normals[chosen])


def _normals_and_areas(corners: NDArray[np.floating]) -> tuple[Float, Float]:
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype(np.float64)
    lengths = np.linalg.norm(across, axis=1)
    return across / np.maximum(lengths, 1e-300)[:, np.newaxis], lengths / 2
