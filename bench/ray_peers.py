"""The peers of the ray backends: the same world and the same rays in Open3D, MuJoCo and pybullet, one thread each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from services.sim.quiet_pybullet import pybullet
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.solids import Box, Cylinder, Solid, Sphere

Float = NDArray[np.float64]

_PYBULLET_BATCH = 16_384
"""pybullet's MAX_RAY_INTERSECTION_BATCH_SIZE."""


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """In the world: origins_m (C, 3), one for all rays of a column, and unit directions (C, R, 3)."""

    origins_m: Float
    directions: Float
    near_m: float
    far_m: float


@dataclass(frozen=True, slots=True)
class Part:
    """A solid of the world."""

    solid: Solid
    T_world_part: SE3


class Peer(Protocol):
    """Casts all rays; how many met something is a check on the peer."""

    def cast(self, rays: Rays) -> int:
        """Number of hits."""


class Open3DPeer:
    """RaycastingScene.cast_rays alone: tree and rays are made beforehand."""

    def __init__(self, parts: Sequence[Part]) -> None:
        open3d: Any = import_module("open3d")
        self._tensor: Any = open3d.core.Tensor
        self._scene: Any = open3d.t.geometry.RaycastingScene(nthreads=1)
        for part in parts:
            mesh = mesh_of(part.solid)
            vertices_m = part.T_world_part.apply(mesh.vertices_m).astype(np.float32)
            self._scene.add_triangles(self._tensor(vertices_m), self._tensor(mesh.triangles))
        self._rays: Rays | None = None
        self._prepared: Any = None
        self.cast(Rays(np.zeros((1, 3)), np.ones((1, 1, 3)), 0.0, 1.0))  # builds the tree

    def prepare(self, rays: Rays) -> None:
        """Makes the tensor of these rays."""
        starts_m = rays.origins_m[:, np.newaxis] + rays.near_m * rays.directions
        self._prepared = self._tensor(np.concatenate([starts_m, rays.directions], axis=-1).astype(np.float32))
        self._rays = rays

    def cast(self, rays: Rays) -> int:
        """Number of hits."""
        if rays is not self._rays:
            self.prepare(rays)
        distance_m = self._scene.cast_rays(self._prepared, nthreads=1)["t_hit"].numpy()
        return int((distance_m <= rays.far_m - rays.near_m).sum())


class MujocoPeer:
    """mj_multiRay on geoms, a call a column: its rays begin at one point."""

    def __init__(self, parts: Sequence[Part]) -> None:
        spec = mujoco.MjSpec()
        for part in parts:
            pose = part.T_world_part
            x, y, z, w = pose.quat_xyzw
            kind, size = _geom_of(part.solid)
            spec.worldbody.add_geom(type=kind, size=size, pos=pose.translation, quat=[w, x, y, z])
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)

    def cast(self, rays: Rays) -> int:
        """Number of hits."""
        num_hits, count = 0, rays.directions.shape[1]
        geoms, distances_m = np.empty(count, dtype=np.int32), np.empty(count)
        starts_m = rays.origins_m
        for start_m, directions in zip(starts_m, rays.directions, strict=True):
            mujoco.mj_multiRay(
                self._model,
                self._data,
                start_m,
                np.ascontiguousarray(directions).reshape(-1),
                None,
                True,
                -1,
                geoms,
                distances_m,
                None,
                count,
                rays.far_m,
            )
            num_hits += int(((distances_m >= 0) & (distances_m <= rays.far_m)).sum())
        return num_hits


class PybulletPeer:
    """rayTestBatch with one thread, in batches as large as it takes."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self._client = {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
        for part in parts:
            kind, size = _bullet_shape(part.solid)
            shape = pybullet.createCollisionShape(kind, **size, **self._client)
            pose = part.T_world_part.xyz_quat_xyzw.tolist()
            pybullet.createMultiBody(0, shape, basePosition=pose[:3], baseOrientation=pose[3:], **self._client)

    def cast(self, rays: Rays) -> int:
        """Number of hits."""
        origins_m = np.broadcast_to(rays.origins_m[:, np.newaxis], rays.directions.shape)
        starts = (origins_m + rays.near_m * rays.directions).reshape(-1, 3)
        ends = (origins_m + rays.far_m * rays.directions).reshape(-1, 3)
        num_hits = 0
        for first in range(0, len(starts), _PYBULLET_BATCH):
            rows = slice(first, first + _PYBULLET_BATCH)
            met = pybullet.rayTestBatch(starts[rows].tolist(), ends[rows].tolist(), numThreads=1, **self._client)
            num_hits += sum(body >= 0 for body, *_ in met)
        return num_hits

    def close(self) -> None:
        """Ends the physics server."""
        pybullet.disconnect(**self._client)


def _geom_of(solid: Solid) -> tuple[Any, list[float]]:
    match solid:
        case Box(size_m):
            return mujoco.mjtGeom.mjGEOM_BOX, [length / 2 for length in size_m]
        case Cylinder(radius_m, length_m):
            return mujoco.mjtGeom.mjGEOM_CYLINDER, [radius_m, length_m / 2, 0]
        case Sphere(radius_m):
            return mujoco.mjtGeom.mjGEOM_SPHERE, [radius_m, 0, 0]
    raise TypeError(f"no geom for a {type(solid).__name__}")


def _bullet_shape(solid: Solid) -> tuple[int, dict[str, Any]]:
    match solid:
        case Box(size_m):
            return pybullet.GEOM_BOX, {"halfExtents": [length / 2 for length in size_m]}
        case Cylinder(radius_m, length_m):
            return pybullet.GEOM_CYLINDER, {"radius": radius_m, "height": length_m}
        case Sphere(radius_m):
            return pybullet.GEOM_SPHERE, {"radius": radius_m}
    raise TypeError(f"no shape for a {type(solid).__name__}")
