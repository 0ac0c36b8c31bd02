"""What predicts where the sensor goes between two scans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from shared.geometry import SE3
from shared.motion import Motion


class Prior(Protocol):
    """Knows how the sensor moves, up to where it started."""

    def motion(self, start_ns: int, end_ns: int) -> Motion | None:
        """T_fixed_sensor over this time, in any frame that stands still; None where nothing is known of it."""

    def step(self, start_ns: int, end_ns: int) -> SE3 | None:
        """T_start_end of the sensor; None where nothing is known of it."""

    def correct(self, stamp_ns: int, T_map_sensor: SE3 | None) -> None:
        """Where registration found the sensor at this time, later than the last; None: it was lost."""


@dataclass(frozen=True, slots=True)
class Step:
    """A predicted motion between two scans. prior: what predicted it. is_measured: it was, and is not only a trend."""

    T_last_now: SE3
    prior: str
    is_measured: bool


def increment(motion: Motion, start_ns: int, end_ns: int) -> SE3:
    """T_start_end: the sensor at the end seen from itself at the start."""
    rotations, translations_m = motion.at([start_ns, end_ns])
    start, end = (SE3(R[0], t[0]) for R, t in zip(rotations, translations_m, strict=True))
    return start.inv() @ end


def step_of(motion_over: Callable[[int, int], Motion | None], start_ns: int, end_ns: int) -> SE3 | None:
    """T_start_end from what gives the motion over a time; the start may be after the end."""
    motion = motion_over(min(start_ns, end_ns), max(start_ns, end_ns))
    return None if motion is None else increment(motion, start_ns, end_ns)
