"""How the LiDAR's kernels are compiled.

All are lean kernels (`shared.kernel`): they allocate nothing, and are given the room they need.

Numba's cache looks at the file of a kernel alone: who changes a part that others compile in empties `__pycache__`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from shared.kernel import lean_kernel

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """A function that is called from Python."""
    return lean_kernel()(function)


def part(function: Function) -> Function:
    """A part of kernels, compiled into each that calls it."""
    return lean_kernel(forceinline=True)(function)


def loop(function: Function) -> Function:
    """A part whose loops are to be vectorised: products and sums may be fused, and the sign of a zero is not kept."""
    return lean_kernel(forceinline=True, fastmath={"contract", "nsz"})(function)


def finite_loop(function: Function) -> Function:
    """The same for loops that look for extremes and never meet NaN."""
    return lean_kernel(forceinline=True, fastmath={"contract", "nsz", "nnan"})(function)
