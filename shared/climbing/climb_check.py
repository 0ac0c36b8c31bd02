"""Judges a climb before the robot tries it: joint limits, collisions on the way, landings, what the magnets hold."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from shared.climbing.climber import Climber
from shared.climbing.stance import Stance
from shared.climbing.transit import line_samples
from shared.geometry import SE3, Float
from shared.messaging.messages import JOINT_NAMES, Foot
from shared.robot.limits import JOINT_UNITS, beyond_limits


@dataclass(frozen=True, slots=True, kw_only=True)
class ClimbLimits:
    """What a climb may do. step_m: how far a point of the robot may move between two samples of a transit."""

    max_depth_m: float = 1e-3
    max_gap_m: float = 0.5e-3
    max_angle_rad: float = math.radians(0.5)
    min_margin: float = 0.0
    step_m: float = 3e-3


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One row of a trajectory: a posture (8,) to go to, or None to change the fixed foot. line: where it stands."""

    line: int
    q: Float | None


@dataclass(frozen=True, slots=True)
class Cut:
    """The deepest place of a transit: `share` of the way (0..1) done, `link` is `depth_m` inside `other`."""

    depth_m: float
    share: float
    link: str
    other: str


@dataclass(frozen=True, slots=True)
class Landing:
    """How a foot stands. gap_m, angle_rad, coverage: as of `SoleContact`; distance_m: to the nearest steel, any way."""

    foot: Foot
    gap_m: float
    angle_rad: float
    coverage: float
    members: tuple[str, ...]
    distance_m: float


@dataclass(frozen=True, slots=True)
class RowReport:
    """What one row does. foot: the one that moves, or that becomes the fixed one. kind: start, move or change.

    limits: joints beyond their limits, in words. cut: None where nothing is touched. landing: None for a move that the
    same foot goes on from. margin: the least holding margin on the way; of a change, that of the foot that is fixed
    after it. problems: what is bad, in words.
    """

    line: int
    kind: str
    foot: Foot
    limits: tuple[str, ...] = ()
    cut: Cut | None = None
    landing: Landing | None = None
    margin: float | None = None
    problems: tuple[str, ...] = ()


class ClimbCheck:
    """Checks trajectories of one robot on one structure."""

    def __init__(self, climber: Climber, limits: ClimbLimits | None = None) -> None:
        self._climber = climber
        self._limits = limits or ClimbLimits()

    def reports(self, rows: Sequence[Row], stance: Stance, q: Float) -> Iterator[RowReport]:
        """A report for where the fixed foot stands at first, in posture q (8,), then one a row."""
        landing = self._landing(stance.fixed_foot, stance.T_world_foot)
        margin, hold_problems = self._hold(stance, q[None])
        problems = (*self._landing_problems(landing), *hold_problems)
        yield RowReport(0, "start", stance.fixed_foot, landing=landing, margin=margin, problems=problems)
        has_landed = False
        for i, row in enumerate(rows):
            if row.q is None:
                yield self._change(row, stance, q, has_landed)
                stance, has_landed = stance.changed(q), False
            else:
                is_landing = i + 1 == len(rows) or rows[i + 1].q is None
                yield self._move(row.line, stance, q, row.q, is_landing)
                q, has_landed = row.q, is_landing

    def _change(self, row: Row, stance: Stance, q: Float, has_landed: bool) -> RowReport:
        """A foot that has just moved was judged by the move."""
        landing = None if has_landed else self._landing(stance.free_foot, stance.T_world_free(q))
        margin, hold_problems = self._hold(stance.changed(q), q[None])
        problems = (*self._landing_problems(landing), *hold_problems)
        return RowReport(row.line, "change", stance.free_foot, landing=landing, margin=margin, problems=problems)

    def _move(self, line: int, stance: Stance, q_start: Float, q_end: Float, is_landing: bool) -> RowReport:
        limits = beyond_limits(JOINT_NAMES, q_end, self._climber.lower, self._climber.upper, JOINT_UNITS)
        samples = line_samples(q_start, q_end, stance, self._climber.collisions.bodies, self._limits.step_m)
        cut = self._cut(stance, samples)
        landing = self._landing(stance.free_foot, stance.T_world_free(q_end)) if is_landing else None
        margin, hold_problems = self._hold(stance, samples)
        problems = (*limits, *self._cut_problems(cut), *self._landing_problems(landing), *hold_problems)
        return RowReport(line, "move", stance.free_foot, tuple(limits), cut, landing, margin, problems)

    def _hold(self, stance: Stance, samples: Float) -> tuple[float, list[str]]:
        """The least margin of postures (S, 8) on the way, and what is bad about it."""
        i, margin = self._climber.holding.worst(stance, samples)
        if margin >= self._limits.min_margin:
            return margin, []
        reason = (
            self._climber.holding.overload(stance, samples[i]) or f"margin must be at least {self._limits.min_margin:g}"
        )
        where = "" if len(samples) == 1 else f" at {100 * i / (len(samples) - 1):.0f} % of the way"
        return margin, [f"foot {stance.fixed_foot.value} lets go{where}: {reason}"]

    def _cut(self, stance: Stance, samples: Float) -> Cut | None:
        contacts = self._climber.collisions.around(stance).contacts(samples)
        i = contacts.deepest()
        if contacts.depth_m[i] <= 0:
            return None
        share = i / max(1, len(samples) - 1)
        return Cut(float(contacts.depth_m[i]), share, contacts.link[i], contacts.other[i])

    def _cut_problems(self, cut: Cut | None) -> list[str]:
        if cut is None or cut.depth_m <= self._limits.max_depth_m:
            return []
        return [f"{cut.link} cuts {1e3 * cut.depth_m:.1f} mm into {cut.other} at {100 * cut.share:.0f} % of the way"]

    def _landing(self, foot: Foot, T_world_foot: SE3) -> Landing:
        contact = self._climber.steel.under_sole(T_world_foot)
        distance_m = self._climber.steel.distance_m(T_world_foot)
        return Landing(foot, contact.gap_m, float(contact.angle_rad), contact.coverage, contact.members, distance_m)

    def _landing_problems(self, landing: Landing | None) -> list[str]:
        if landing is None:
            return []
        foot = f"foot {landing.foot.value}"
        if not landing.coverage:
            return [f"{foot} ends {1e3 * landing.distance_m:.0f} mm from any steel"]
        limits, problems = self._limits, []
        if abs(landing.gap_m) > limits.max_gap_m:
            word = "above" if landing.gap_m > 0 else "sunk into"
            problems.append(f"{foot} ends {1e3 * abs(landing.gap_m):.2f} mm {word} {', '.join(landing.members)}")
        if landing.angle_rad > limits.max_angle_rad:
            problems.append(f"{foot} is tilted by {math.degrees(landing.angle_rad):.2f} deg")
        if landing.coverage < 1:
            problems.append(f"only {100 * landing.coverage:.0f} % of the sole of {foot} is over steel")
        return problems
