"""A beam of finite width as a bundle of sub-rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Footprint:
    """A beam leaves an exit of this diameter and widens by this full angle. 0 and 0 = a line."""

    exit_m: float
    divergence_rad: float


def sub_rays() -> NDArray[np.float64]:
    """Where K = 7 sub-rays of equal weight cross a beam's section (K, 2): to its left and upwards, in radii.

    The first is the beam's axis, six stand around it at the mean radius of what is left of the disc: a seventh each.
    """
    angle = np.pi / 3 * np.arange(6)
    radius = (2 / 3) * (1 - (1 / 7) ** 1.5) / (1 - 1 / 7)
    return np.concatenate([np.zeros((1, 2)), radius * np.stack([np.sin(angle), np.cos(angle)], axis=1)])
