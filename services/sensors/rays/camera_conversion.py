"""Faces drawn into the rows of an image."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from services.sensors.depth.pinhole import Pinhole
from services.sensors.rays.camera_kernels import Faces, View, draw, finish
from services.sensors.rays.interface import NO_FACE, Hits, Poses
from services.sensors.scene import Scene


class CameraConversion:
    """Draws images, on one thread. What is drawn is exact at pixel centres, so nothing thin falls between them."""

    def __init__(self) -> None:
        self._faces: Faces | None = None
        self._hits = _no_hits(0, 0)

    def set_scene(self, scene: Scene) -> None:
        """Takes what can be seen."""
        self._faces = faces_of(scene)

    def image(self, camera: Pinhole, poses: Poses, near_m: float, far_m: float) -> Hits:
        """The first hits between the depths `near_m` and `far_m` through each pixel; near_m is above 0.

        The next image overwrites the arrays: fresh pages would cost more than what is drawn on them.

        Raises:
            ValueError: no scene was set.
        """
        if self._faces is None:
            raise ValueError("set_scene comes first")
        R, t = poses.sensor_rotation[0], poses.sensor_translation_m[0]
        rotations = R.T @ poses.link_rotation[0]
        translations_m = (poses.link_translation_m[0] - t) @ R
        view = View(
            camera.height, camera.width, camera.fx, camera.fy, camera.cx, camera.cy, float(near_m), float(far_m)
        )
        if self._hits.face.shape != (camera.height, camera.width):
            self._hits = _no_hits(camera.height, camera.width)
        hits = self._hits
        distance_m = np.zeros(max(1, len(self._faces.normals)), dtype=np.float32)
        draw(self._faces, rotations, translations_m, view, hits.range_m, hits.face, distance_m)
        finish(hits.range_m, hits.face, distance_m, view, hits.cos_incidence)
        return hits


def _no_hits(height: int, width: int) -> Hits:
    range_m, cos_incidence = (np.zeros((height, width), dtype=np.float32) for _ in range(2))
    return Hits(range_m=range_m, face=np.full((height, width), NO_FACE, dtype=np.int32), cos_incidence=cos_incidence)


def faces_of(scene: Scene) -> Faces:
    """The scene with the planes of its faces and the bounding spheres of its shapes."""
    normals = _normals(scene)
    first_vertex = scene.vertices_m[scene.starts[:-1]]
    num_shapes = len(scene.shape_link)
    first_face = np.searchsorted(scene.shape, np.arange(num_shapes + 1))
    bounds = scene.starts[first_face]
    centres_m, radii_m = np.zeros((num_shapes, 3)), np.zeros(num_shapes)
    for i, (start, end) in enumerate(itertools.pairwise(bounds)):
        if start < end:
            points = scene.vertices_m[start:end]
            centres_m[i] = (points.min(axis=0) + points.max(axis=0)) / 2
            radii_m[i] = np.linalg.norm(points - centres_m[i], axis=1).max() * (1 + 1e-9)
    return Faces(
        vertices_m=np.ascontiguousarray(scene.vertices_m),
        starts=scene.starts,
        normals=normals,
        offsets_m=np.einsum("fk,fk->f", normals, first_vertex),
        first_face=first_face,
        shape_link=scene.shape_link,
        is_convex=scene.is_convex,
        centres_m=centres_m,
        radii_m=radii_m,
    )


def _normals(scene: Scene) -> NDArray[np.float64]:
    """Unit normals (F, 3) by Newell's method, 0 for faces without area."""
    if scene.num_faces == 0:
        return np.empty((0, 3))
    sizes = np.diff(scene.starts)
    following = np.arange(len(scene.vertices_m)) + 1
    following[scene.starts[1:] - 1] = scene.starts[:-1]
    first = np.repeat(scene.vertices_m[scene.starts[:-1]], sizes, axis=0)
    across = np.cross(scene.vertices_m - first, scene.vertices_m[following] - first)
    areas = np.add.reduceat(across, scene.starts[:-1], axis=0)
    lengths = np.linalg.norm(areas, axis=1, keepdims=True)
    return areas / np.where(lengths > 0.0, lengths, 1.0)
