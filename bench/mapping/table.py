"""The figures as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.mapping.measuring import Timing
from bench.mapping.scoring import Score

_HEAD = (
    "| | ms a scan | p99 | wall | dropped at 10 / 20 Hz | ATE mm | RPE mm / deg | pairs right | says it is lost / wrong unsaid "
    "| points off 11 planes | map accuracy mm |\n|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|"
)


@dataclass(frozen=True, slots=True)
class Row:
    """One contender's figures. timing: None for the true poses. problem: why there are no figures.

    num_lost: scans that it says it is lost at. num_silent: wrong steps between scans of which it does not say so.
    """

    label: str
    timing: Timing | None = None
    score: Score | None = None
    num_lost: int | None = None
    num_silent: int | None = None
    problem: str = ""


def markdown(rows: Sequence[Row]) -> str:
    """A table, a line a contender; those without figures are named below it with the reason."""
    lines = [_line(row, row.score) for row in rows if row.score is not None]
    absent = [f"- {row.label}: {row.problem}" for row in rows if row.score is None]
    return "\n".join([_HEAD, *lines, *(["", "Not measured:", "", *absent] if absent else [])]) + "\n"


def _line(row: Row, score: Score) -> str:
    timing = row.timing
    cells = [
        row.label,
        "" if timing is None else _short(timing.ms_mean),
        "" if timing is None else _short(timing.ms_p99),
        "" if timing is None else _short(timing.wall_ms_mean),
        "" if timing is None else f"{timing.num_dropped_10hz} / {timing.num_dropped_20hz}",
        _short(score.ate_mm),
        f"{_short(score.rpe_mm)} / {score.rpe_deg:.2f}",
        f"{score.num_pairs_ok} of {score.num_pairs}",
        "" if row.num_lost is None else f"{row.num_lost} / {row.num_silent}",
        str(score.num_off_planes),
        f"{score.map_accuracy_mm:.2f}",
    ]
    return f"| {' | '.join(cells)} |"


def _short(value: float) -> str:
    """Two digits after the point below 10, one below 100, none above."""
    return f"{value:.{2 if value < 10 else 1 if value < 100 else 0}f}"
