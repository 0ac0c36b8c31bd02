"""Eigenvalues of symmetric 3x3 matrices, by hand: a call of a library costs more than the matrix."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from shared.kernel import lean_kernel

Float = NDArray[np.float64]

_MAX_SWEEPS = 12
"""Cyclic Jacobi converges quadratically: 5 or 6 sweeps are usual at double precision."""


@lean_kernel()
def _rotation(app: float, aqq: float, apq: float) -> tuple[float, float]:
    """Cosine and sine of the Givens rotation that clears the element apq."""
    theta = (aqq - app) / (2.0 * apq)
    tangent = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
    return cosine, tangent * cosine


@lean_kernel()
def _rotate(A: Float, V: Float, p: int, q: int) -> None:
    """A <- G^T A G and V <- V G, with the rotation G in the plane of p and q that makes A[p, q] 0."""
    if abs(A[p, q]) < 1e-300:
        return
    c, s = _rotation(A[p, p], A[q, q], A[p, q])
    for k in range(3):
        a, b = A[k, p], A[k, q]
        A[k, p], A[k, q] = c * a - s * b, s * a + c * b
    for k in range(3):
        a, b = A[p, k], A[q, k]
        A[p, k], A[q, k] = c * a - s * b, s * a + c * b
        a, b = V[k, p], V[k, q]
        V[k, p], V[k, q] = c * a - s * b, s * a + c * b


@lean_kernel()
def _swap_if_less(A: Float, V: Float, i: int, j: int) -> None:
    if A[j, j] < A[i, i]:
        A[i, i], A[j, j] = A[j, j], A[i, i]
        for k in range(3):
            V[k, i], V[k, j] = V[k, j], V[k, i]


@lean_kernel()
def diagonalise(A: Float, V: Float) -> None:
    """Symmetric A (3, 3) becomes diagonal, smallest first; V's columns are then its unit eigenvectors.

    Source: Golub, Van Loan, "Matrix Computations", the cyclic Jacobi method.
    """
    for row in range(V.shape[0]):
        for column in range(V.shape[1]):
            V[row, column] = 0.0
    for k in range(3):
        V[k, k] = 1.0
    for _ in range(_MAX_SWEEPS):
        off = abs(A[0, 1]) + abs(A[0, 2]) + abs(A[1, 2])
        if off <= 1e-15 * (abs(A[0, 0]) + abs(A[1, 1]) + abs(A[2, 2])):
            break
        _rotate(A, V, 0, 1)
        _rotate(A, V, 0, 2)
        _rotate(A, V, 1, 2)
    _swap_if_less(A, V, 0, 1)
    _swap_if_less(A, V, 1, 2)
    _swap_if_less(A, V, 0, 1)
