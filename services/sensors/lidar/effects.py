"""From what the beams of a LiDAR truly meet to what it measures: signal, dropouts, noise, mixed pixels, gates.

All randomness is a function of seed, stamp and beam: a beam's noise depends on nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.sensors.lidar.beams import Beams
from services.sensors.lidar.measuring import measured_ranges, mixed_returns, packed
from services.sensors.rays.interface import EdgeHits, Hits
from services.sensors.scene import Scene
from shared.runtime.sensor_config import LidarConfig, SurfaceConfig

Floats = NDArray[np.float32]

_DETECTION_REFLECTIVITY = 0.1
"""Of the surface at which a datasheet states the range of detection."""
_SURE_ODDS = 2.0**24
"""Against a dropout: beyond what the random numbers resolve."""


@dataclass(frozen=True, slots=True, eq=False)
class Returns:
    """What came back (N,), ring by ring: points_m (N, 3) in the sensor's frame, column, ring, intensity.

    intensity: 255 times reflectivity and the cosine of incidence, which is the signal corrected for range. face,
    true_range_m: what was truly met, and where; of a mixed pixel, by the nearest of its sub-rays that came back. Both
    are (0,) unless the truth is asked for.
    """

    points_m: Floats
    column: NDArray[np.int32]
    ring: NDArray[np.uint16]
    intensity: Floats
    face: NDArray[np.int32]
    true_range_m: Floats


class LidarEffects:
    """The errors of one LiDAR in front of one scene. own_shapes: which of its shapes are the LiDAR's own robot."""

    def __init__(self, config: LidarConfig, beams: Beams, scene: Scene, own_shapes: slice, seed: int) -> None:
        self._seed = np.uint64(seed)
        self._origins_m = beams.origins_m().astype(np.float32)
        self._rotations = beams.column_rotations().astype(np.float32)
        self._directions = beams.ring_directions().astype(np.float32)
        surfaces = [config.surfaces.get(material, config.surfaces["default"]) for material in scene.materials]
        self._surfaces = np.array([_surface_row(surface, config.incidence_fade_deg) for surface in surfaces])
        self._surfaces = self._surfaces.reshape(-1, 4).astype(np.float32)[scene.shape]
        is_robot = np.zeros(len(surfaces), dtype=np.bool_)
        is_robot[own_shapes] = True
        self._is_filtered = (is_robot & config.body_filter)[scene.shape]
        even_signal = _DETECTION_REFLECTIVITY / config.detection_range_m**2 if config.detection_range_m else 0.0
        sure_weakness = _SURE_ODDS ** (-1 / config.detection_steepness)
        self._detection = np.array([even_signal, config.detection_steepness, sure_weakness])
        self._noise_m = np.array([config.range_noise_m, config.weak_range_noise_m, config.range_quantum_m])
        self._gate_m = np.array([config.min_range_m, config.max_range_m, beams.origin_m])
        self._pulse_m = config.pulse_m
        self._with_truth = config.truth

    def apply(self, hits: Hits, edges: EdgeHits | None, stamp_ns: int) -> Returns:
        """What the sensor reports of these hits. edges: None = beams are lines."""
        range_m, face, brightness = hits.range_m, hits.face, np.full(hits.face.shape, np.nan, dtype=np.float32)
        true_range_m = range_m
        if edges is not None and len(edges.cells):
            range_m, true_range_m, face = range_m.copy(), range_m.copy(), face.copy()
            met = (edges.cells, edges.range_m, edges.face, edges.cos_incidence)
            mixed_returns(*met, self._surfaces, self._pulse_m, range_m, true_range_m, face, brightness)
        seen = (range_m, face, hits.cos_incidence, brightness, self._surfaces, self._is_filtered)
        measured_m, intensity, counts = measured_ranges(
            *seen, self._detection, self._noise_m, self._gate_m, self._seed, stamp_ns
        )
        beams = self._origins_m, self._rotations, self._directions
        return Returns(*packed(measured_m, intensity, counts, face, true_range_m, *beams, self._with_truth))


def _surface_row(surface: SurfaceConfig, fade_deg: float) -> tuple[float, float, float, float]:
    """Reflectivity; cosine of the angle at which returns begin to fade; that angle and the one where they end."""
    if surface.max_incidence_deg >= 90.0:
        return surface.reflectivity, -1.0, np.pi, np.pi
    start_rad, end_rad = np.deg2rad([max(0.0, surface.max_incidence_deg - fade_deg), surface.max_incidence_deg])
    return surface.reflectivity, float(np.cos(start_rad)), float(start_rad), float(end_rad)
