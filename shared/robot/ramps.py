"""How a motion speeds up and slows down: evenly over a ramp at either end, even between (a trapezoid of speed)."""

from __future__ import annotations


def ramped_share(elapsed: float, total: float, ramp: float) -> tuple[float, float]:
    """Share of the way that is done, 0..1, and its change a unit of time.

    elapsed: time since the motion began; total: its duration; ramp: of either end, at most half of it. All in
    one unit. Before the motion the share is 0, after it 1, and neither changes.
    """
    if elapsed >= total:
        return 1.0, 0.0
    if elapsed <= 0:
        return 0.0, 0.0
    top = 1.0 / (total - ramp)
    left = total - elapsed
    if elapsed < ramp:
        return 0.5 * top * elapsed**2 / ramp, top * elapsed / ramp
    if left < ramp:
        return 1.0 - 0.5 * top * left**2 / ramp, top * left / ramp
    return top * (elapsed - 0.5 * ramp), top
