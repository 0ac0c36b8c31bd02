"""How the LiDAR's kernels are compiled.

Without numba's reference counting (`_nrt=False`), which costs more than the arithmetic where many arrays are handed
down to small functions: so kernels allocate nothing, and are given the room they need. Division by zero gives inf.

Numba's cache looks at the file of a kernel alone: who changes a part that others compile in empties `__pycache__`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy", "_nrt": False}


def kernel(function: Function) -> Function:
    """A function that is called from Python."""
    compiled: Function = njit(**_OPTIONS)(function)
    return compiled


def part(function: Function) -> Function:
    """A part of kernels, compiled into each that calls it."""
    compiled: Function = njit(**_OPTIONS, forceinline=True)(function)
    return compiled


def loop(function: Function) -> Function:
    """A part whose loops are to be vectorised: products and sums may be fused, and the sign of a zero is not kept."""
    compiled: Function = njit(**_OPTIONS, forceinline=True, fastmath={"contract", "nsz"})(function)
    return compiled


def finite_loop(function: Function) -> Function:
    """The same for loops that look for extremes and never meet NaN."""
    compiled: Function = njit(**_OPTIONS, forceinline=True, fastmath={"contract", "nsz", "nnan"})(function)
    return compiled
