"""The beams of a spinning LiDAR: their angles, and where in the sensor they begin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry import SE3


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """R beams that fire together, C times a revolution, clockwise seen from above as the Ouster OS1 turns.

    elevation_rad (R,): top to bottom. azimuth_rad (R,): each beam's own, added to the encoder's, counter-clockwise.
    origin_m: distance of the beams' origin from the axis, towards where the encoder points. T_sensor_lidar: from the
    frame in which the beams turn to that in which points are given.

    Source: Ouster sensor data format. Its table of azimuths has the opposite sign.
    """

    elevation_rad: NDArray[np.float64]
    azimuth_rad: NDArray[np.float64]
    origin_m: float
    T_sensor_lidar: SE3
    num_columns: int

    @property
    def encoder_rad(self) -> NDArray[np.float64]:
        """(C,): 2 pi (1 - column / C), less a whole turn."""
        return -2.0 * np.pi / self.num_columns * np.arange(self.num_columns, dtype=np.float64)

    def origins_m(self) -> NDArray[np.float64]:
        """Where the beams of each column begin (C, 3), in the sensor's frame."""
        encoder = self.encoder_rad
        ring = np.stack([np.cos(encoder), np.sin(encoder), np.zeros_like(encoder)], axis=-1)
        origins_m: NDArray[np.float64] = self.origin_m * ring @ self.T_sensor_lidar.rotation.T
        return origins_m + self.T_sensor_lidar.translation

    def column_rotations(self) -> NDArray[np.float64]:
        """How each column (C, 3, 3) turns `ring_directions` into the sensor's frame."""
        cos, sin = np.cos(self.encoder_rad), np.sin(self.encoder_rad)
        zero, one = np.zeros_like(cos), np.ones_like(cos)
        turns = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], axis=-1).reshape(-1, 3, 3)
        rotations: NDArray[np.float64] = self.T_sensor_lidar.rotation @ turns
        return rotations

    def ring_directions(self) -> NDArray[np.float64]:
        """Unit vectors (R, 3) of the beams while the encoder points along x."""
        flat = np.cos(self.elevation_rad)
        x, y = flat * np.cos(self.azimuth_rad), flat * np.sin(self.azimuth_rad)
        return np.stack([x, y, np.sin(self.elevation_rad)], axis=-1)

    def directions(self) -> NDArray[np.float64]:
        """Unit vectors (C, R, 3) in the sensor's frame."""
        directions: NDArray[np.float64] = np.einsum("cij,rj->cri", self.column_rotations(), self.ring_directions())
        return directions


def uniform_beams(num_rings: int, top_deg: float, bottom_deg: float, num_columns: int) -> Beams:
    """Evenly spaced elevations, no offsets: what simulators commonly use."""
    elevation_rad = np.deg2rad(np.linspace(top_deg, bottom_deg, num_rings))
    return Beams(elevation_rad, np.zeros(num_rings), 0.0, SE3.identity(), num_columns)
