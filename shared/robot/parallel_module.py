"""The parallel module 2RPR-PR: two pistons, left and right, lift and tilt a platform that slides on a core link.

The platform's centre is y_m above the base's on the module's axis and tilted by phi_rad, towards the longer left piston
where positive. Working mode: y > 0 and, of the tilts that fit, the smallest.

Source: Peidro, Gil, Marin, Paya, Reinoso (UMH Elche), papers on the HyReCRo robot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shared.geometry import Float

_MAX_ITERATIONS = 60
_ROUNDING_M = 1e-14
"""Left by rounding in the module's equation, whose terms are up to a piston's length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleGeometry:
    """Lengths of one module in metres, remembered from the robot's papers: to be measured on the prototype."""

    base_half_m: float = 0.04
    """From the axis to where a piston is held on the base."""
    platform_half_m: float = 0.04
    """From the axis to where a piston is held on the platform."""
    min_piston_m: float = 0.19
    max_piston_m: float = 0.25


MODULE = ModuleGeometry()


def pistons_from_platform(y_m: ArrayLike, phi_rad: ArrayLike, geometry: ModuleGeometry = MODULE) -> tuple[Float, Float]:
    """Lengths l and r in metres of the left and right piston for a platform at y_m, phi_rad; all (...)."""
    y, phi = np.asarray(y_m, dtype=np.float64), np.asarray(phi_rad, dtype=np.float64)
    across = geometry.platform_half_m * np.cos(phi) - geometry.base_half_m
    rise = geometry.platform_half_m * np.sin(phi)
    return np.hypot(across, y + rise), np.hypot(across, y - rise)


def platform_from_pistons(l_m: ArrayLike, r_m: ArrayLike, geometry: ModuleGeometry = MODULE) -> tuple[Float, Float]:
    """y_m and phi_rad of the platform for pistons l_m and r_m, all (...); NaN where the pistons do not fit together.

    Sum and difference of the squared lengths give y^2 = S + 2 b p cos(phi) and y sin(phi) = K. What is left,
    sin(phi) sqrt(S + 2 b p cos(phi)) = K, is the papers' cubic in cos(phi), but keeps its digits at phi = 0. It rises
    and is concave up to the smallest root, so Newton's method comes to it from below and meets no other.
    """
    left, right = np.broadcast_arrays(np.asarray(l_m, dtype=np.float64), np.asarray(r_m, dtype=np.float64))
    b, p = geometry.base_half_m, geometry.platform_half_m
    S = (left**2 + right**2) / 2 - b**2 - p**2
    K = np.abs((left - right) * (left + right) / (4 * p))
    with np.errstate(invalid="ignore", divide="ignore"):
        phi = np.arcsin(K / np.sqrt(S + 2 * b * p))
        for _ in range(_MAX_ITERATIONS):
            y = np.sqrt(S + 2 * b * p * np.cos(phi))
            residual = np.sin(phi) * y - K
            slope = np.cos(phi) * y - b * p * np.sin(phi) ** 2 / y
            phi = np.where(slope > 0, phi - residual / slope, np.nan)
            if not (np.abs(residual) > _ROUNDING_M).any():
                break
        y = np.sqrt(S + 2 * b * p * np.cos(phi))
        fits = (left > 0) & (right > 0) & (y > 0) & (np.abs(np.sin(phi) * y - K) <= _ROUNDING_M)
    return np.where(fits, y, np.nan), np.where(fits, np.sign(left - right) * phi, np.nan)
