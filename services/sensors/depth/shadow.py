"""What the right imager does not see: pixels of the left one that something nearer hides from it."""

from __future__ import annotations

import math

import numpy as np

from services.sensors.depth.correlated import Float32
from services.sensors.kernel import kernel

_STEP_PX = np.float32(1.0)
"""A rise of the disparity by more than this from one pixel to the next is an outline. A surface rises by the baseline
over the distance of its plane, so by less if that is farther than the baseline."""


@kernel()
def shade_row(disparity_px: Float32, nearest_px: Float32) -> None:
    """Sets the disparity (W,) of each pixel of a row to 0 that the right imager does not see.

    A point in column u is in column u - disparity there: left of its image, or behind what has a larger disparity
    there. nearest_px (W,) is scratch.
    """
    largest, largest_rise = _extent(disparity_px)
    reach_px = int(largest) + 2
    if largest_rise > _STEP_PX:
        _draw_nearest(disparity_px, nearest_px)
        _drop_hidden(disparity_px, nearest_px, reach_px)
    for u in range(min(len(disparity_px), reach_px)):
        if u - disparity_px[u] < np.float32(-0.5):
            disparity_px[u] = np.float32(0.0)


@kernel(fastmath={"nnan", "nsz", "reassoc"})
def _extent(disparity_px: Float32) -> tuple[np.float32, np.float32]:
    """The largest disparity of a row and its largest rise from one pixel to the next."""
    largest, rise = disparity_px[0], np.float32(0.0)
    for u in range(1, len(disparity_px)):
        largest = max(largest, disparity_px[u])
        rise = max(rise, disparity_px[u] - disparity_px[u - 1])
    return largest, rise


@kernel()
def _draw_nearest(disparity_px: Float32, nearest_px: Float32) -> None:
    """The largest disparity that the right imager sees in each column, of the parts that can hide anything.

    Those begin at an outline and end where the right imager sees them beside all that is left of the outline.
    """
    nearest_px[:] = np.float32(0.0)
    outline = -1
    before = disparity_px[0]
    for u in range(1, len(disparity_px)):
        disparity = disparity_px[u]
        column_before, column = u - 1 - before, u - disparity
        if disparity - before > _STEP_PX:
            outline = u
        elif column_before > outline:
            outline = -1
        if outline >= 0:
            is_surface = abs(disparity - before) <= _STEP_PX
            first = math.ceil(column_before) if is_surface else int(np.rint(column))
            for seen in range(max(first, 0), int(np.rint(column)) + 1):
                nearest_px[seen] = max(nearest_px[seen], disparity)
        before = disparity


@kernel()
def _drop_hidden(disparity_px: Float32, nearest_px: Float32, reach_px: int) -> None:
    """Pixels left of an outline, within reach, are set to 0 if something nearer is in their column."""
    tested = 0
    width = len(disparity_px)
    before = disparity_px[0]
    for u in range(1, width):
        disparity = disparity_px[u]
        if disparity - before > _STEP_PX:
            for hidden in range(max(tested, u - reach_px), u):
                column = int(np.rint(hidden - disparity_px[hidden]))
                if column >= 0 and nearest_px[column] > disparity_px[hidden] + _STEP_PX:
                    disparity_px[hidden] = np.float32(0.0)
            tested = u
        before = disparity
