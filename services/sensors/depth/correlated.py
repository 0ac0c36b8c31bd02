"""Noise that neighbouring pixels share: normal numbers on a coarse grid, interpolated by quadratic B-splines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.sensors.noise_hash import normal
from shared.kernel import kernel

Float32 = NDArray[np.float32]

_KNOTS_PER_HALF_WIDTH = 1.0 / np.sqrt(np.log(2.0))
"""The correlation of a field with knots every g pixels is near to exp(-lag^2 / g^2), which is 1/2 at g sqrt(ln 2)."""


class Spline(NamedTuple):
    """How pixels take part in three knots a direction, with weights whose squares sum to 1: the variance stays even.

    first_row (H,), first_column (W,): the first of the three. row_weights (H, 3), column_weights (W, 3).
    """

    first_row: NDArray[np.int64]
    row_weights: Float32
    first_column: NDArray[np.int64]
    column_weights: Float32


def spline_of(height: int, width: int, correlation_px: float) -> Spline:
    """For fields whose correlation falls to one half at a lag of `correlation_px` along rows and columns."""
    spacing_px = correlation_px * _KNOTS_PER_HALF_WIDTH
    return Spline(*_along(height, spacing_px), *_along(width, spacing_px))


def _along(num_pixels: int, spacing_px: float) -> tuple[NDArray[np.int64], Float32]:
    at = np.arange(num_pixels) / spacing_px
    first = np.floor(at + 0.5).astype(np.int64)
    t = at + 0.5 - first
    weights = np.stack([(1 - t) ** 2 / 2, 0.5 + t - t * t, t * t / 2], axis=1)
    return first, (weights / np.linalg.norm(weights, axis=1, keepdims=True)).astype(np.float32)


@kernel()
def knot_rows(spline: Spline, seed: np.uint64, stream: int) -> Float32:
    """The rows of knots (K, W), interpolated along themselves; `add_row` interpolates between them."""
    num_rows, num_columns = spline.first_row[-1] + 3, spline.first_column[-1] + 3
    knots = np.empty(num_columns, dtype=np.float32)
    rows = np.empty((num_rows, len(spline.first_column)), dtype=np.float32)
    for row in range(num_rows):
        for column in range(num_columns):
            knots[column] = normal(seed, stream, row * num_columns + column)
        for u in range(len(spline.first_column)):
            first, weights = spline.first_column[u], spline.column_weights[u]
            rows[row, u] = weights[0] * knots[first] + weights[1] * knots[first + 1] + weights[2] * knots[first + 2]
    return rows


@kernel(fastmath={"contract"})
def add_row(rows: Float32, spline: Spline, v: int, sigma: np.float32, values: Float32) -> None:
    """Adds row v of the field, of standard deviation `sigma`, to values (W,)."""
    first, weights = spline.first_row[v], spline.row_weights[v]
    a, b, c = sigma * weights[0], sigma * weights[1], sigma * weights[2]
    above, middle, below = rows[first], rows[first + 1], rows[first + 2]
    for u in range(len(values)):
        values[u] += a * above[u] + b * middle[u] + c * below[u]


@kernel()
def field(spline: Spline, seed: np.uint64, stream: int, sigma: np.float32) -> Float32:
    """The whole field (H, W)."""
    rows = knot_rows(spline, seed, stream)
    values = np.zeros((len(spline.first_row), len(spline.first_column)), dtype=np.float32)
    for v in range(len(values)):
        add_row(rows, spline, v, sigma, values[v])
    return values
