"""What the joints' encoders say: the truth with a bias that stays and noise that does not.

The drives know positions from the encoders only: a joint that shall go to q stands at q - bias when it is there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.messaging.messages import JOINT_NAMES
from shared.runtime.config import EncoderConfig

_IS_PISTON = np.array([name in ("q2", "q7") for name in JOINT_NAMES])


class Encoders:
    """Reads joint positions. bias (8,) is drawn once, rad and m; rng is the only source of bias and noise."""

    def __init__(self, config: EncoderConfig, rng: np.random.Generator) -> None:
        self._rng = rng
        self._noise = np.where(_IS_PISTON, config.piston_noise_m, config.noise_rad)
        self.bias = np.where(_IS_PISTON, config.piston_bias_m, config.bias_rad) * rng.standard_normal(len(JOINT_NAMES))

    def read(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Measured positions (8,) of true ones, radians and metres; exact where nothing is configured."""
        return q + self.bias + self._noise * self._rng.standard_normal(len(q))
