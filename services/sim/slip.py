"""How a foot slides along the steel when it takes hold."""

from __future__ import annotations

import numpy as np

from services.sim.state import rng_text, set_rng
from shared.geometry import SE3
from shared.runtime.config import SlipConfig


class Slip:
    """Draws a slip a change of foot: Gaussian along both axes of the sole and about its normal. rng: its only noise."""

    def __init__(self, config: SlipConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng

    def reseed(self, rng: np.random.Generator) -> None:
        """Goes on with other noise."""
        self._rng = rng

    @property
    def rng_text(self) -> str:
        """The state of the noise."""
        return rng_text(self._rng)

    def restore(self, text: str) -> None:
        """Goes on from a state of the noise.

        Raises:
            ValueError: the text is no such state.
        """
        set_rng(self._rng, text)

    def next(self) -> SE3:
        """T_foot_slipped: how the foot moves, in its own frame; it stays in the plane of its sole."""
        x, y, turn = self._rng.standard_normal(3).tolist()
        slide_m, turn_rad = self._config.slide_m, np.deg2rad(self._config.turn_deg)
        if slide_m == 0 and turn_rad == 0:
            return SE3.identity()
        return SE3.trans(slide_m * x, slide_m * y) @ SE3.rot("z", turn_rad * turn)
