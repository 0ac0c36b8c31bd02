"""Where the rays of a spinning LiDAR point: one ring a laser, one column a firing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.runtime.config import LidarConfig


def uniform_elevations(config: LidarConfig) -> NDArray[np.float64]:
    """Elevation (R, 1) of each ring in radians, evenly spaced, top to bottom."""
    top_rad, bottom_rad = np.deg2rad([config.max_elevation_deg, config.min_elevation_deg])
    return np.linspace(top_rad, bottom_rad, config.num_rings)[:, np.newaxis]


def uniform_azimuths(config: LidarConfig) -> NDArray[np.float64]:
    """Azimuth (1, C) of each column in radians about z, from x: clockwise seen from above, as the Ouster OS1 turns.

    Source: Ouster sensor data format, encoder angle 2 pi (1 - m / W) of measurement m in W.
    """
    return np.linspace(0.0, -2.0 * np.pi, config.num_columns, endpoint=False)[np.newaxis, :]


def directions(elevation_rad: NDArray[np.float64], azimuth_rad: NDArray[np.float64]) -> NDArray[np.float32]:
    """Unit vectors (R, C, 3) in the sensor's frame; both angles broadcast to (R, C), so tables per beam fit too."""
    elevation, azimuth = np.broadcast_arrays(elevation_rad, azimuth_rad)
    flat = np.cos(elevation)
    vectors = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)
    return vectors.astype(np.float32)


def scan_directions(config: LidarConfig) -> NDArray[np.float32]:
    """Unit vectors (R, C, 3) of the whole scan, rings top to bottom, columns in the order they fire."""
    return directions(uniform_elevations(config), uniform_azimuths(config))
