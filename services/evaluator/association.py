"""Which poses of an estimated and a true trajectory belong together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shared.geometry import SE3

StampedPoses = Sequence[tuple[int, SE3]]
Pairs = NDArray[np.int64]

_NS_PER_S = 10**9


def by_stamp(estimated: StampedPoses, true: StampedPoses, max_dt_ns: int) -> Pairs:
    """Rows (P, 2) of estimate and truth that are nearest in time, at most `max_dt_ns` apart; each is used once.

    Both trajectories must be in the order of their stamps.
    """
    stamps_ns, true_ns = _stamps_ns(estimated), _stamps_ns(true)
    if len(stamps_ns) == 0 or len(true_ns) == 0:
        return np.empty((0, 2), dtype=np.int64)
    after = np.clip(np.searchsorted(true_ns, stamps_ns), min(1, len(true_ns) - 1), len(true_ns) - 1)
    before = np.maximum(after - 1, 0)
    is_before = stamps_ns - true_ns[before] <= true_ns[after] - stamps_ns
    nearest = np.where(is_before, before, after)
    apart_ns = np.abs(true_ns[nearest] - stamps_ns)
    order = np.lexsort((apart_ns, nearest))
    order = order[apart_ns[order] <= max_dt_ns]
    _, first = np.unique(nearest[order], return_index=True)
    rows = np.sort(order[first])
    return np.column_stack([rows, nearest[rows]])


def by_index(estimated: StampedPoses, true: StampedPoses) -> Pairs:
    """Rows (P, 2) where the estimate's stamps count the true poses from 0, one a second."""
    numbers = [stamp_ns // _NS_PER_S for stamp_ns, _ in estimated]
    pairs = [(row, number) for row, number in enumerate(numbers) if number < len(true)]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def is_indexed(estimated: StampedPoses, num_true: int) -> bool:
    """Whether all stamps are whole seconds that could count the true poses from 0."""
    return all(stamp_ns % _NS_PER_S == 0 and stamp_ns // _NS_PER_S < num_true for stamp_ns, _ in estimated)


def _stamps_ns(poses: StampedPoses) -> NDArray[np.int64]:
    return np.array([stamp_ns for stamp_ns, _ in poses], dtype=np.int64)
