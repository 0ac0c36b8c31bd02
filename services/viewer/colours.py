"""The colours of the scene. Red, green, blue, 0..255."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

BACKGROUND = (18, 22, 26)
MAP = (96, 118, 150)
TRUE_TRAIL = (250, 250, 250)
ESTIMATED_TRAIL = (255, 60, 172)

JOINTS = (
    (230, 75, 53),
    (245, 166, 35),
    (241, 226, 77),
    (126, 200, 80),
    (64, 196, 190),
    (84, 140, 240),
    (160, 108, 226),
    (232, 110, 180),
)

MAX_RANGE_M = 4.0
"""Points that far or farther have the last colour."""


def range_colours(points_m: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Colour (N, 3) of points (N, 3) by their distance to the sensor, from dark blue over green to dark red."""
    ranges_m = np.sqrt(np.einsum("ij,ij->i", points_m, points_m))
    rows = np.minimum(ranges_m * (255.0 / MAX_RANGE_M), 255.0).astype(np.uint8)
    coloured: NDArray[np.uint8] = _turbo()[rows]
    return coloured


@functools.cache
def _turbo() -> NDArray[np.uint8]:
    """(256, 3): Anton Mikhailov's colour map Turbo."""
    from matplotlib import colormaps

    table: NDArray[np.uint8] = colormaps["turbo"](np.arange(256), bytes=True)[:, :3]
    return table
