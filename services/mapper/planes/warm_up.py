"""Compiles the kernels of this package, by running everything once on a small room."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.growth import map_of_scans
from services.mapper.planes.matcher import PlaneMatcher
from services.mapper.planes.refinement import refine
from services.mapper.registration import Points
from shared.geometry import SE3
from shared.runtime.config import MapperConfig


def warm_up() -> None:
    """Tracks, searches, localises and refines two scans of a room of 4 m x 3 m x 2 m, as float32 and as float64."""
    room: tuple[Points, ...] = (_room(), _room().astype(np.float32))
    for scan in room:
        scans: list[Points] = [scan, scan]
        poses = [SE3.identity(), SE3.identity()]
        matcher = PlaneMatcher(MapperConfig())
        matcher.start(scan, poses[0])
        matcher.align(scan, [SE3.trans(5.0), poses[0]], 1.0)
        matcher.accept(SE3.trans(0.05))
        matcher.localise(scan)
        matcher.align(scan[::-1], poses, 1.0)
        shuffled = np.random.default_rng(0).permutation(scan)
        matcher.align(shuffled, poses, 1.0)
        refine(scans, poses, map_of_scans(scans, [T.matrix[:3] for T in poses], MapperConfig()))


def _room() -> NDArray[np.float64]:
    """Where rays from the inside of a box meet it (N, 3), row by row."""
    elevation, azimuth = np.meshgrid(np.radians(np.linspace(-40, 40, 40)), np.radians(np.arange(0.0, 360.0, 2.0)))
    rays = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    ).reshape(-1, 3)
    with np.errstate(divide="ignore"):
        ranges_m = np.min(np.where(rays > 0, [2.3, 1.6, 1.1], [1.7, 1.4, 0.9]) / np.abs(rays), axis=1)
    points_m: NDArray[np.float64] = rays * ranges_m[:, np.newaxis]
    return points_m
