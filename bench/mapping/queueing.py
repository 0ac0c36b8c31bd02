"""What a method misses that is slower than the sensor."""

from __future__ import annotations

from collections.abc import Sequence


def num_dropped(scan_ms: Sequence[float], period_ms: float) -> int:
    """How many scans are never taken, when scan k arrives at k periods and only the newest waits.

    scan_ms: how long each takes once it is taken.
    """
    num_scans, num_taken, k, free_ms = len(scan_ms), 0, 0, 0.0
    while k < num_scans:
        newest = min(int(free_ms // period_ms), num_scans - 1)
        k = max(k, newest)
        free_ms = max(free_ms, k * period_ms) + scan_ms[k]
        num_taken += 1
        k += 1
    return num_scans - num_taken
