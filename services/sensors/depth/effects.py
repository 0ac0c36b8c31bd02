"""A stereo camera's errors, put on the true depths of an image."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from services.sensors.depth.correlated import field, spline_of
from services.sensors.depth.effect_kernels import Stereo, match
from services.sensors.depth.pinhole import Pinhole
from services.sensors.noise_hash import hash64
from services.sensors.rays.interface import Hits
from shared.runtime.sensor_config import DepthConfig

_IMAGE_STREAM, _STATIC_STREAM = 0, 1


class StereoEffects:
    """Measures images. All of its noise is a function of seed and stamp, whatever images came before.

    The disparity fx * baseline / z gets noise that neighbours share (Gaussian-like, correlation one half at a lag of
    correlation_px), noise of the same kind that stays, and noise of each pixel alone; so the error of the depth grows
    with its square. Depths are whole millimetres.
    """

    def __init__(self, config: DepthConfig, camera: Pinhole, seed: int) -> None:
        self._seed = np.uint64(seed % 2**64)
        self._spline = spline_of(camera.height, camera.width, config.correlation_px)
        self._stereo = Stereo(
            focal_baseline_px_m=np.float32(camera.fx * config.baseline_m),
            correlated_noise_px=np.float32(config.correlated_noise_px),
            white_noise_px=np.float32(config.white_noise_px),
            disparity_quantum_px=np.float32(config.disparity_quantum_px),
            max_disparity_px=np.float32(config.max_disparity_px),
            min_range_m=np.float32(config.min_range_m),
            max_range_m=np.float32(config.max_range_m),
            edge_jitter_px=np.float32(config.edge_jitter_px),
            has_shadow=config.shadow,
            max_incidence_rad=math.radians(config.max_incidence_deg),
            fade_rad=math.radians(config.incidence_fade_deg),
        )
        self._static_px = np.empty((0, 0), dtype=np.float32)
        if config.static_noise_px > 0:
            self._static_px = field(self._spline, self._seed, _STATIC_STREAM, np.float32(config.static_noise_px))

    def measure(self, hits: Hits, stamp_ns: int) -> NDArray[np.uint16]:
        """Depths (H, W) in mm, 0 where there is none, of what each pixel truly meets."""
        seed = np.uint64(hash64(self._seed, _IMAGE_STREAM, stamp_ns))
        return match(hits.range_m, hits.cos_incidence, self._static_px, self._spline, self._stereo, seed)
