"""Rays by Open3D's RaycastingScene (Embree): takes any mesh; the reference for the other backend."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.sensors.depth.pinhole import Pinhole
from services.sensors.lidar.beams import Beams
from services.sensors.lidar.footprint import Footprint, sub_rays
from services.sensors.rays.bodies import surfaces_of
from services.sensors.rays.interface import NO_FACE, EdgeHits, Hits, Poses
from services.sensors.scene import Scene

Float = NDArray[np.float64]


class EmbreeBackend:
    """Casts every ray, on one thread; the tree is built anew for each block of columns.

    Measured with 21 bars, the robot and 512 x 128 rays on one core: building costs 0.4 ms, casting 11 ms. The scene
    keeps the world's axes: Embree's boxes fit bars along them tightly, turned bars take twice as long.
    """

    def __init__(self) -> None:
        self._open3d: Any = import_module("open3d")  # two seconds and 80 MB: only for those who cast rays
        self._scene: Scene | None = None
        self._triangles = np.empty((0, 3), dtype=np.uint32)
        self._face_of_triangle = np.empty(0, dtype=np.int32)
        self._link_of_vertex = np.empty(0, dtype=np.int32)
        self._surface_of_face = np.empty(0, dtype=np.int32)

    def set_scene(self, scene: Scene) -> None:
        """Takes what the rays can meet."""
        sizes = np.diff(scene.starts)
        fan = [
            start + np.array([[0, i, i + 1] for i in range(1, size - 1)])
            for start, size in zip(scene.starts[:-1], sizes, strict=True)
        ]
        self._triangles = np.concatenate([*fan, np.empty((0, 3))]).astype(np.uint32)
        self._face_of_triangle = np.repeat(np.arange(scene.num_faces), np.maximum(sizes - 2, 0)).astype(np.int32)
        self._link_of_vertex = np.repeat(scene.shape_link[scene.shape], sizes)
        self._surface_of_face = surfaces_of(scene)
        self._scene = scene

    def scan(self, beams: Beams, poses: Poses, near_m: float, far_m: float) -> Hits:
        """The first hits between `near_m` and `far_m` along each beam."""
        origins = np.broadcast_to(beams.origins_m()[:, np.newaxis], (*beams.directions().shape,))
        return self._scan(origins, beams.directions(), poses, near_m, far_m)

    def edges(self, beams: Beams, poses: Poses, near_m: float, far_m: float, footprint: Footprint) -> EdgeHits:
        """Casts all sub-rays of all beams and keeps those that differ."""
        origins, directions = beams.origins_m()[:, np.newaxis], beams.directions()
        up_axis = beams.T_sensor_lidar.rotation[:, 2]
        left = np.cross(up_axis, directions)
        left /= np.linalg.norm(left, axis=-1, keepdims=True)
        up = np.cross(directions, left)
        met = []
        for to_left, upwards in sub_rays():
            aside = to_left * left + upwards * up
            widened = directions + np.tan(footprint.divergence_rad / 2) * aside
            widened /= np.linalg.norm(widened, axis=-1, keepdims=True)
            met.append(self._scan(origins + footprint.exit_m / 2 * aside, widened, poses, near_m, far_m))
        faces = np.stack([hits.face.reshape(-1) for hits in met], axis=1)
        surfaces = np.append(self._surface_of_face, NO_FACE)[faces]
        cells = np.flatnonzero((surfaces != surfaces[:, :1]).any(axis=1))
        return EdgeHits(
            cells=cells,
            range_m=np.stack([hits.range_m.reshape(-1)[cells] for hits in met], axis=1),
            face=faces[cells],
            cos_incidence=np.stack([hits.cos_incidence.reshape(-1)[cells] for hits in met], axis=1),
        )

    def image(self, camera: Pinhole, poses: Poses, near_m: float, far_m: float) -> Hits:
        """The first hits between the depths `near_m` and `far_m` through each pixel."""
        directions = camera.rays() @ poses.sensor_rotation[0].T
        built = self._built(poses, 0, poses.sensor_translation_m[0])
        return self._cast(built, np.zeros_like(directions), directions, near_m, far_m)

    def _scan(self, origins_m: Float, directions: Float, poses: Poses, near_m: float, far_m: float) -> Hits:
        num_columns, num_blocks = len(directions), len(poses.link_rotation)
        R, t = poses.sensor_rotation, poses.sensor_translation_m
        directions = np.einsum("nij,nrj->nri", np.broadcast_to(R, (num_columns, 3, 3)), directions)
        centre_m = t[len(t) // 2]
        rotated = np.einsum("nij,nrj->nri", np.broadcast_to(R, (num_columns, 3, 3)), origins_m)
        origins_m = rotated + (t - centre_m)[:, np.newaxis]
        block = np.arange(num_columns) * num_blocks // num_columns
        parts = []
        for b in range(num_blocks):
            rows = block == b
            built = self._built(poses, b, centre_m)
            parts.append(self._cast(built, origins_m[rows], directions[rows], near_m, far_m))
        return Hits(
            range_m=np.concatenate([part.range_m for part in parts]),
            face=np.concatenate([part.face for part in parts]),
            cos_incidence=np.concatenate([part.cos_incidence for part in parts]),
        )

    def _built(self, poses: Poses, block: int, centre_m: Float) -> Any:
        """The tree of the scene as it stands in that block, its coordinates from `centre_m` on."""
        if self._scene is None:
            raise ValueError("set_scene comes first")
        R = poses.link_rotation[block][self._link_of_vertex]
        t = poses.link_translation_m[block][self._link_of_vertex]
        vertices_m = np.einsum("vij,vj->vi", R, self._scene.vertices_m) + t - centre_m
        tensor = self._open3d.core.Tensor
        built = self._open3d.t.geometry.RaycastingScene(nthreads=1)
        if len(self._triangles):
            built.add_triangles(tensor(vertices_m.astype(np.float32)), tensor(self._triangles))
        return built

    def _cast(self, built: Any, origins_m: Float, directions: Float, near_m: float, far_m: float) -> Hits:
        rays = np.concatenate([origins_m + near_m * directions, directions], axis=-1).astype(np.float32)
        met = {
            name: values.numpy() for name, values in built.cast_rays(self._open3d.core.Tensor(rays), nthreads=1).items()
        }
        range_m = np.float32(near_m) + met["t_hit"]
        is_hit = range_m <= far_m
        lengths = np.linalg.norm(directions, axis=-1)
        cosines = np.abs(np.einsum("...k,...k->...", met["primitive_normals"], directions)) / lengths
        triangle = np.where(is_hit, met["primitive_ids"], 0)
        faces = self._face_of_triangle if len(self._face_of_triangle) else np.zeros(1, dtype=np.int32)
        return Hits(
            range_m=np.where(is_hit, range_m, np.float32(np.inf)),
            face=np.where(is_hit, faces[triangle], NO_FACE).astype(np.int32),
            cos_incidence=np.where(is_hit, cosines, 0.0).astype(np.float32),
        )
