"""Moments of points: all that a set of points says of any plane, in ten numbers.

Moments (10,) are the upper triangle, row by row, of the sum of h h^T over the points' h = (x, y, z, 1), weighted or
not: xx xy xz x, yy yz y, zz z, 1. Those of a union are the sum. A plane a = (n, d) is n.x + d = 0 with n of length 1;
the sum of squared distances to it is a^T M a.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.eigen import diagonalise
from shared.kernel import kernel, lean_kernel

Float = NDArray[np.float64]

NUM_MOMENTS = 10


@lean_kernel()
def add_point(M: Float, x: float, y: float, z: float) -> None:
    """Adds a point of weight 1."""
    M[0] += x * x
    M[1] += x * y
    M[2] += x * z
    M[3] += x
    M[4] += y * y
    M[5] += y * z
    M[6] += y
    M[7] += z * z
    M[8] += z
    M[9] += 1.0


@lean_kernel()
def squares_to(M: Float, a0: float, a1: float, a2: float, a3: float) -> float:
    """The sum of squared distances to the plane (a0, a1, a2, a3)."""
    diagonal = a0 * a0 * M[0] + a1 * a1 * M[4] + a2 * a2 * M[7] + a3 * a3 * M[9]
    mixed = a0 * (a1 * M[1] + a2 * M[2] + a3 * M[3]) + a1 * (a2 * M[5] + a3 * M[6]) + a2 * a3 * M[8]
    return float(diagonal + 2.0 * mixed)


@lean_kernel()
def times(M: Float, a: Float, column: int, out: Float) -> None:
    """Column of out (4, C) = M a, with that column of a (4, C)."""
    a0, a1, a2, a3 = a[0, column], a[1, column], a[2, column], a[3, column]
    out[0, column] = M[0] * a0 + M[1] * a1 + M[2] * a2 + M[3] * a3
    out[1, column] = M[1] * a0 + M[4] * a1 + M[5] * a2 + M[6] * a3
    out[2, column] = M[2] * a0 + M[5] * a1 + M[7] * a2 + M[8] * a3
    out[3, column] = M[3] * a0 + M[6] * a1 + M[8] * a2 + M[9] * a3


@lean_kernel()
def add_moved(M: Float, R: Float, x: float, y: float, z: float, out: Float) -> None:
    """Adds to `out` the moments of the points R p + (x, y, z), where M are those of the points p."""
    w = M[9]
    sx = R[0, 0] * M[3] + R[0, 1] * M[6] + R[0, 2] * M[8]
    sy = R[1, 0] * M[3] + R[1, 1] * M[6] + R[1, 2] * M[8]
    sz = R[2, 0] * M[3] + R[2, 1] * M[6] + R[2, 2] * M[8]
    out[0] += _turned(M, R, 0, 0) + 2.0 * sx * x + w * x * x
    out[1] += _turned(M, R, 0, 1) + sx * y + sy * x + w * x * y
    out[2] += _turned(M, R, 0, 2) + sx * z + sz * x + w * x * z
    out[3] += sx + w * x
    out[4] += _turned(M, R, 1, 1) + 2.0 * sy * y + w * y * y
    out[5] += _turned(M, R, 1, 2) + sy * z + sz * y + w * y * z
    out[6] += sy + w * y
    out[7] += _turned(M, R, 2, 2) + 2.0 * sz * z + w * z * z
    out[8] += sz + w * z
    out[9] += w


@lean_kernel()
def _turned(M: Float, R: Float, i: int, j: int) -> float:
    """Element (i, j) of R S R^T, with the second moments S (3, 3) in M."""
    a, b, c = R[j, 0], R[j, 1], R[j, 2]
    return float(
        R[i, 0] * (M[0] * a + M[1] * b + M[2] * c)
        + R[i, 1] * (M[1] * a + M[4] * b + M[5] * c)
        + R[i, 2] * (M[2] * a + M[5] * b + M[7] * c)
    )


@kernel()
def fit_plane(M: Float, plane: Float) -> tuple[float, float]:
    """Writes the plane (4,) of least squares; returns the variances across it and along its shorter side.

    M must be about a point near the plane: the squares of far coordinates swallow the millimetres.
    """
    w = M[9]
    mx, my, mz = M[3] / w, M[6] / w, M[8] / w
    C, V = np.empty((3, 3)), np.empty((3, 3))
    C[0, 0], C[1, 1], C[2, 2] = M[0] / w - mx * mx, M[4] / w - my * my, M[7] / w - mz * mz
    C[0, 1] = C[1, 0] = M[1] / w - mx * my
    C[0, 2] = C[2, 0] = M[2] / w - mx * mz
    C[1, 2] = C[2, 1] = M[5] / w - my * mz
    diagonalise(C, V)
    plane[0], plane[1], plane[2] = V[0, 0], V[1, 0], V[2, 0]
    plane[3] = -(V[0, 0] * mx + V[1, 0] * my + V[2, 0] * mz)
    return max(C[0, 0], 0.0), C[1, 1]
