"""numba's compiler as decorators that keep the types of what they compile."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def kernel(**options: Any) -> Callable[[F], F]:
    """Compiles to machine code at the first call, and keeps that in numba's cache. Division by 0 is IEEE 754's.

    options: those of `numba.njit`.
    """
    compile_it: Callable[[F], F] = njit(cache=True, error_model="numpy", **options)
    return compile_it


def lean_kernel(**options: Any) -> Callable[[F], F]:
    """The same without counting references, which costs more than the arithmetic where small functions get arrays.

    Such a kernel allocates nothing and assigns no slices; it is given the room it needs.
    """
    return kernel(_nrt=False, **options)
