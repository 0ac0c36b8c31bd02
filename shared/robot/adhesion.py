"""How near a magnetic foot is to letting go of flat steel.

Wrenches are those of the steel on the foot (`statics.holding_wrench`), at the sole's centre, z from the steel towards
the robot. The magnet presses foot and steel together with F; a robot that pulls with N leaves F - N of contact,
pressure adds to it. A foot holds while three loads stay below what this contact bears:

- pull: N <= F
- tilt: |mx|, |my| <= (F - N) a, or the foot turns about an edge; a is half the sole's width
- shear: |fxy| + |mz| / r <= mu (F - N), or the foot slips. A square sole that presses evenly resists twisting alone
  with mu (F - N) r, r = a (sqrt 2 + ln(1 + sqrt 2)) / 3, its points' mean distance from the centre. The true limit of
  both together is convex (Goyal, Ruina & Papadopoulos 1991), so the straight line between the two is on the safe side.

Divided by F each reads "utilisation <= 1", which is proportional to the load.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import Float


@dataclass(frozen=True, slots=True, kw_only=True)
class MagnetLimits:
    """What a foot's magnet and sole can do."""

    pull_n: float = 323.7
    """33 kg a leg, as published for the robot."""
    half_width_m: float = 0.05
    """Of the square sole, as in the URDF."""
    friction: float = 0.5
    """Between sole and steel: assumed, dry, neither oiled nor rusty."""

    @property
    def twist_radius_m(self) -> float:
        """Lever with which friction under the sole resists twisting about the sole's normal."""
        return self.half_width_m * (math.sqrt(2) + math.log(1 + math.sqrt(2))) / 3


def margin(wrench: ArrayLike, limits: MagnetLimits) -> Float:
    """1 where nothing loads the foot, 0 where it lets go, below 0 beyond: (...) for wrenches (..., 6) in N and Nm.

    Raises:
        ValueError: the wrench is not (..., 6).
    """
    pull_n, tilt_nm, shear_n = _loads(wrench, limits)
    most = np.maximum(tilt_nm / limits.half_width_m, shear_n / limits.friction)  # neither is below 0: covers pull alone
    return 1.0 - np.maximum(most + pull_n, 0.0) / limits.pull_n


def overload(wrench: ArrayLike, limits: MagnetLimits) -> str | None:
    """Which limit a wrench (6,) is beyond, with load and limit; None if the foot holds.

    Raises:
        ValueError: the wrench is not (6,).
    """
    if np.shape(wrench) != (6,):
        raise ValueError(f"wrench must be (6,), got {np.shape(wrench)}")
    if margin(wrench, limits) >= 0:
        return None
    pull_n, tilt_nm, shear_n = (float(load) for load in _loads(wrench, limits))
    contact_n = limits.pull_n - pull_n
    if not contact_n > 0:
        return f"pull is {pull_n:.4g} N, must be at most {limits.pull_n:.4g} N"
    where = f"with {pull_n:.4g} N of pull" if pull_n > 0 else f"with {-pull_n:.4g} N of pressure"
    if tilt_nm / limits.half_width_m > shear_n / limits.friction:
        return f"tilt is {tilt_nm:.4g} Nm, must be at most {contact_n * limits.half_width_m:.4g} Nm {where}"
    return f"shear with twist is {shear_n:.4g} N, must be at most {contact_n * limits.friction:.4g} N {where}"


def _loads(wrench: ArrayLike, limits: MagnetLimits) -> tuple[Float, Float, Float]:
    """Pull in N (below 0: pressure), tilt in Nm, shear with twist in N, each (...)."""
    values = np.asarray(wrench, dtype=np.float64)
    if values.shape[-1:] != (6,):
        raise ValueError(f"wrench must be (..., 6), got {values.shape}")
    fx, fy, fz, mx, my, mz = np.moveaxis(values, -1, 0)
    tilt_nm = np.maximum(np.abs(mx), np.abs(my))
    return -fz, tilt_nm, np.hypot(fx, fy) + np.abs(mz) / limits.twist_radius_m
