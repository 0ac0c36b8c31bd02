"""One magnetic foot: when it takes hold, and what it can bear."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.climbing.steel import SoleContact
from shared.messaging.messages import Foot
from shared.robot.adhesion import MagnetLimits, margin, overload
from shared.runtime.config import MagnetConfig


class Magnet:
    """The magnet of a foot, switched on where it is asked to hold."""

    def __init__(self, foot: Foot, config: MagnetConfig) -> None:
        self._foot = foot
        self._config = config
        self._max_angle_rad = float(np.deg2rad(config.max_angle_deg))
        self._limits = MagnetLimits(pull_n=config.pull_n, half_width_m=config.half_width_m, friction=config.friction)

    def can_hold(self, contact: SoleContact) -> bool:
        """Whether this is enough steel, near enough."""
        return contact.is_flush(self._config.max_gap_m, self._max_angle_rad)

    def no_hold_text(self, contact: SoleContact) -> str:
        """Why it cannot hold there."""
        found = "there is no steel below it"
        if contact.coverage > 0:
            found = (
                f"{contact.coverage:.0%} of its sole are over steel, {contact.gap_m * 1000:.1f} mm and "
                f"{np.rad2deg(contact.angle_rad):.1f} deg off"
            )
        config = self._config
        allowed = f"{config.max_gap_m * 1000:g} mm and {config.max_angle_deg:g} deg"
        return f"foot {self._foot.value} does not hold: {found}; it takes hold within {allowed} of steel"

    def margin(self, wrench: NDArray[np.float64]) -> float:
        """What is left of its limits under a wrench (6,) at its sole: 1 unloaded, 0 lets go."""
        return float(margin(wrench, self._limits))

    def overload(self, wrench: NDArray[np.float64]) -> str | None:
        """Which limit a wrench (6,) exceeds, None if it holds."""
        reason = overload(wrench, self._limits)
        return None if reason is None else f"foot {self._foot.value} lets go: {reason}"
