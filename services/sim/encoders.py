"""What the joints' encoders say: the truth with a bias that stays and noise that does not.

The drives know positions from the encoders only: a joint that shall go to q stands at q - bias when it is there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.sim.state import rng_text, set_rng
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

    @property
    def rng_text(self) -> str:
        """The state of the noise."""
        return rng_text(self._rng)

    def restore(self, bias: NDArray[np.float64], text: str) -> None:
        """Goes on with the bias (8,) and the state of the noise of others.

        Raises:
            ValueError: the text is no such state.
        """
        set_rng(self._rng, text)
        self.bias = bias
