"""What the right imager does not see: pixels of the left one that something nearer hides from it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from services.sensors.depth.correlated import Float32
from shared.kernel import kernel

_STEP_PX = np.float32(1.0)
"""A rise of the disparity by more than this from one pixel to the next is an outline. A surface rises by the baseline
over the distance of its plane, so by less if that is farther than the baseline."""
_CHUNK_PX = 64


@kernel()
def shade_row(disparity_px: Float32, nearest_px: Float32, outlines: NDArray[np.int32]) -> None:
    """Sets the disparity (W,) of each pixel of a row to 0 that the right imager does not see.

    A point in column u is in column u - disparity there: left of its image, or behind what has a larger disparity
    there. nearest_px (W,), outlines (W,) are scratch.
    """
    reach_px = int(_largest(disparity_px)) + 2
    num_outlines = _find_outlines(disparity_px, outlines)
    if num_outlines > 0:
        nearest_px[:] = np.float32(0.0)
        for i in range(num_outlines):
            _draw_nearest(disparity_px, outlines[i], nearest_px)
        for i in range(num_outlines):
            first = max(outlines[i] - reach_px, outlines[i - 1] if i > 0 else 0)
            _drop_hidden(disparity_px[first : outlines[i]], first, nearest_px)
    for u in range(min(len(disparity_px), reach_px)):
        if u - disparity_px[u] < np.float32(-0.5):
            disparity_px[u] = np.float32(0.0)


@kernel(fastmath={"nnan", "nsz"})
def _largest(disparity_px: Float32) -> np.float32:
    largest = np.float32(0.0)
    for u in range(len(disparity_px)):
        largest = max(largest, disparity_px[u])
    return largest


@kernel()
def _find_outlines(disparity_px: Float32, outlines: NDArray[np.int32]) -> int:
    """Writes the columns at which the disparity rises; how many they are."""
    num, width = 0, len(disparity_px)
    for start in range(1, width, _CHUNK_PX):
        end = min(start + _CHUNK_PX, width)
        if _rises(disparity_px[start - 1 : end]):
            for u in range(start, end):
                if disparity_px[u] - disparity_px[u - 1] > _STEP_PX:
                    outlines[num] = u
                    num += 1
    return num


@kernel()
def _rises(disparity_px: Float32) -> bool:
    num_rises = 0
    for u in range(1, len(disparity_px)):
        num_rises += disparity_px[u] - disparity_px[u - 1] > _STEP_PX
    return num_rises > 0


@kernel()
def _draw_nearest(disparity_px: Float32, outline: int, nearest_px: Float32) -> None:
    """The largest disparity that the right imager sees in each column, of what can hide pixels left of the outline.

    That ends at the next outline, or where the right imager sees it beside all that is left of this one.
    """
    before, column_before = np.float32(0.0), np.float32(0.0)
    for u in range(outline, len(disparity_px)):
        disparity = disparity_px[u]
        if u > outline and (disparity - before > _STEP_PX or column_before > outline):
            return
        column = np.float32(u) - disparity
        last = int(np.rint(column))
        is_surface = u > outline and before - disparity <= _STEP_PX
        for seen in range(max(math.ceil(column_before) if is_surface else last, 0), last + 1):
            nearest_px[seen] = max(nearest_px[seen], disparity)
        before, column_before = disparity, column


@kernel()
def _drop_hidden(disparity_px: Float32, first: int, nearest_px: Float32) -> None:
    """Pixels from column `first` on are set to 0 if something nearer is in their column."""
    for i in range(len(disparity_px)):
        column = int(np.rint(np.float32(first + i) - disparity_px[i]))
        if column >= 0 and nearest_px[column] > disparity_px[i] + _STEP_PX:
            disparity_px[i] = np.float32(0.0)
