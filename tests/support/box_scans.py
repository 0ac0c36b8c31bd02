"""Scans of boxes by arithmetic: an exact LiDAR for tests of the method `plane`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from shared.geometry import SE3


@dataclass(frozen=True)
class Box:
    """T_world_box at its centre, and half its edges."""

    T_world_box: SE3
    half_m: tuple[float, float, float]


def frame_of_bars(T_world_frame: SE3 | None = None) -> list[Box]:
    """Bars of 0.2 m about the origin, unlike in every direction, so that each pose sees them differently."""
    T = T_world_frame or SE3.identity()
    bars = [
        ((0.0, 1.2, -0.6), (3.0, 0.1, 0.1)),
        ((0.3, -1.5, -0.4), (2.5, 0.1, 0.1)),
        ((1.6, 0.2, -0.6), (0.1, 1.9, 0.1)),
        ((-1.4, 0.0, 0.9), (0.1, 2.1, 0.1)),
        ((1.1, 1.2, 0.4), (0.1, 0.1, 1.3)),
        ((-0.9, -1.5, 0.2), (0.1, 0.1, 1.6)),
        ((0.2, 0.9, 1.4), (2.0, 0.1, 0.1)),
    ]
    return [Box(T @ SE3.trans(*centre), half) for centre, half in bars]


def room() -> list[Box]:
    """The inside of 4 m x 3 m x 2 m, as six thick walls; the origin is off its middle."""
    walls = [
        ((2.4, 0.1, 0.1), (0.1, 2.0, 2.0)),
        ((-1.8, 0.1, 0.1), (0.1, 2.0, 2.0)),
        ((0.3, 1.7, 0.1), (2.5, 0.1, 2.0)),
        ((0.3, -1.5, 0.1), (2.5, 0.1, 2.0)),
        ((0.3, 0.1, 1.2), (2.5, 2.0, 0.1)),
        ((0.3, 0.1, -1.0), (2.5, 2.0, 0.1)),
    ]
    return [Box(SE3.trans(*centre), half) for centre, half in walls]


def grid_of_rays(num_rows: int = 128, num_columns: int = 512) -> np.ndarray:
    """Unit vectors (N, 3), row by row, 45 degrees up and down."""
    elevation, azimuth = np.meshgrid(
        np.radians(np.linspace(-45, 45, num_rows)), np.arange(num_columns) * 2 * np.pi / num_columns, indexing="ij"
    )
    return np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    ).reshape(-1, 3)


def scan(boxes: list[Box], T_world_lidar: SE3, rays: np.ndarray, sigma_m: object = 0.0, seed: int = 0) -> np.ndarray:
    """Points (N, 3) in the lidar frame, of the rays that meet a box (slab method); noise along the rays.

    sigma_m: a number, or a function of the ranges.
    """
    ranges_m = np.full(len(rays), np.inf)
    for box in boxes:
        T_box_lidar = box.T_world_box.inv() @ T_world_lidar
        enter, leave = np.full(len(rays), -np.inf), np.full(len(rays), np.inf)
        for axis, half_m in enumerate(box.half_m):
            with np.errstate(divide="ignore"):
                inverse = 1.0 / (rays @ T_box_lidar.rotation[axis])
            ends = (
                (-half_m - T_box_lidar.translation[axis]) * inverse,
                (half_m - T_box_lidar.translation[axis]) * inverse,
            )
            enter, leave = np.maximum(enter, np.minimum(*ends)), np.minimum(leave, np.maximum(*ends))
        ranges_m = np.where((enter < leave) & (enter > 0.0), np.minimum(ranges_m, enter), ranges_m)
    met = np.isfinite(ranges_m)
    sigmas_m = sigma_m(ranges_m[met]) if callable(sigma_m) else np.full(met.sum(), sigma_m)
    noisy_m = ranges_m[met] + sigmas_m * np.random.default_rng(seed).normal(size=met.sum())
    return (rays[met] * noisy_m[:, np.newaxis]).astype(np.float32)


def path(num_scans: int, step_rad: float = 0.15) -> list[SE3]:
    """Poses from the identity on, turning and moving a little each."""
    step = SE3.exp([0.03, 0.015, 0.01, 0.1 * step_rad, -0.15 * step_rad, step_rad])
    poses = [SE3.identity()]
    for _ in range(num_scans - 1):
        poses.append(poses[-1] @ step)
    return poses
