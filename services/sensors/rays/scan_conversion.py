"""Rays by drawing faces into the sensor's grid: a lattice is a few hundred convex faces, and no tree is built."""

from __future__ import annotations

from services.sensors.depth.pinhole import Pinhole
from services.sensors.lidar.beams import Beams
from services.sensors.lidar.footprint import Footprint
from services.sensors.rays.camera_conversion import CameraConversion
from services.sensors.rays.interface import EdgeHits, Hits, Poses
from services.sensors.rays.lidar_conversion import LidarConversion
from services.sensors.scene import Scene


class ScanConversionBackend:
    """Draws scans and images, on one thread."""

    def __init__(self) -> None:
        self._scans, self._images = LidarConversion(), CameraConversion()

    def set_scene(self, scene: Scene) -> None:
        """Takes what the rays can meet."""
        self._scans.set_scene(scene)
        self._images.set_scene(scene)

    def scan(self, beams: Beams, poses: Poses, near_m: float, far_m: float) -> Hits:
        """The first hits between `near_m` and `far_m` along each beam."""
        return self._scans.scan(beams, poses, near_m, far_m)

    def edges(self, beams: Beams, poses: Poses, near_m: float, far_m: float, footprint: Footprint) -> EdgeHits:
        """What the sub-rays meet of the beams near an edge."""
        return self._scans.edges(beams, poses, near_m, far_m, footprint)

    def image(self, camera: Pinhole, poses: Poses, near_m: float, far_m: float) -> Hits:
        """The first hits between the depths `near_m` and `far_m` through each pixel."""
        return self._images.image(camera, poses, near_m, far_m)
