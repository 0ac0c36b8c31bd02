"""Measurement noise of a range sensor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def add_range_noise(range_m: NDArray[np.float32], sigma_m: float, rng: np.random.Generator) -> NDArray[np.float32]:
    """A noisy copy of the ranges (R, C): Gaussian of standard deviation `sigma_m` along the ray; inf stays inf.

    Every ray draws one value, hit or not, so the noise of a ray depends on the generator alone and not on the scene.
    """
    return range_m + np.float32(sigma_m) * rng.standard_normal(range_m.shape, dtype=np.float32)
