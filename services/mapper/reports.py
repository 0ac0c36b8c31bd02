"""What the mapper says to people: that it is lost, is back, that a foot slipped."""

from __future__ import annotations

import math

from services.mapper.slip import Disagreement
from services.mapper.tracking import Track
from shared.messaging.messages import Event, MapStatus, Severity

Said = tuple[Severity, str]


class Reports:
    """Turns what changed from scan to scan into events."""

    def __init__(self) -> None:
        self._num_lost = 0
        self._axes: tuple[str, ...] = ()

    def restart(self) -> None:
        """A new run: nothing was said yet."""
        self._num_lost, self._axes = 0, ()

    def restored(self, stamp_ns: int, age_ns: int, num_points: int) -> Event:
        """The map of an earlier mapper goes on; age_ns: between the map that was kept and its last scan."""
        text = (
            f"restored at {stamp_ns / 1e9:.2f} s: goes on in its map of {num_points} points, "
            f"kept {age_ns / 1e9:.1f} s before"
        )
        return Event(stamp_ns=stamp_ns, seq=0, frame="", source="mapper", severity=Severity.WARNING, text=text)

    def events(self, status: MapStatus, track: Track, slip: Disagreement | None) -> list[Event]:
        """slip: how far legs and scans disagree, where that is a slip."""
        said = [*self._tracking(status, track), *self._degeneracy(status)]
        if slip is not None:
            distance_mm, angle_deg = slip.distance_m * 1000, math.degrees(slip.angle_rad)
            text = f"a foot slipped: legs and scans differ by {distance_mm:.0f} mm, {angle_deg:.1f} deg in a second"
            said.append((Severity.WARNING, text))
        return [
            Event(stamp_ns=status.stamp_ns, seq=0, frame="", source="mapper", severity=severity, text=text)
            for severity, text in said
        ]

    def _tracking(self, status: MapStatus, track: Track) -> list[Said]:
        was_lost = self._num_lost
        self._num_lost = 0 if track.is_tracking else was_lost + 1
        if self._num_lost == 1:
            return [(Severity.WARNING, f"lost: scan {status.scan_seq} {_why(status, track)}; the map stays as it is")]
        if was_lost and track.is_tracking:
            how = "by a search of the whole map" if track.is_found_again else "near the prediction"
            return [(Severity.INFO, f"found again after {was_lost} lost scans, {how}")]
        return []

    def _degeneracy(self, status: MapStatus) -> list[Said]:
        axes, before = status.degenerate_axes if status.is_tracking else self._axes, self._axes
        self._axes = axes
        if axes == before or not axes:
            return []
        return [(Severity.INFO, f"scans do not determine {' '.join(axes)}: held by the prior ({status.prior})")]


def _why(status: MapStatus, track: Track) -> str:
    if track.result is None:
        return "has too few points to begin a map"
    if status.is_suspect:
        return "fits in two places"
    return f"is explained by the map to {status.score:.0%} only, or is too far from where it was expected"
