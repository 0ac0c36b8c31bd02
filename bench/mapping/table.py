"""The figures as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.mapping.measuring import Timing
from bench.mapping.scoring import Score

_HEAD = (
    "| | ms a scan | p99 | wall | dropped at 10 / 20 Hz | ATE mm | RPE mm / deg | pairs right "
    "| lost / wrong unsaid | points off 11 planes | map accuracy mm |\n|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|"
)

INTRODUCTION = """\
Made by `python -m bench.mapping --peers-python PEERS/bin/python --json FILE --markdown FILE`; all figures are measured,
none are taken from elsewhere. PEERS is an environment with `kiss-icp`, `genz-icp` and numpy; PCL takes part after
`make -C bench/pcl`, where libpcl-dev is installed. `--data DIR` takes your own scans. Without it `climb` is the shipped
climb in 75 scans with 8 mm noise, and `climb_hard` the same in 25 with 30 mm and leg odometry as prior.

- Every contender gets the same points, from 0.5 to 10 m, and runs in a process of its own with one thread, bound to one
  core; contenders run in turn, as often as stated. Reading files is not timed; range gate, thinning, normals,
  registration and the map that it needs are. The first scan, which only begins the map, is not counted.
- **ms a scan**: CPU time, the median of the runs' means; **p99** of it; **wall**: the same mean of wall time, with
  whatever else the machine did. **dropped**: scans missed when they arrive at that rate and the newest waits.
- **ATE**, **RPE**: root mean squares; first poses laid together, no other alignment. **pairs right**: steps from a
  scan to the next within 5 cm and 1 degree. **lost / wrong unsaid**: scans that our mapper says it is lost at, and
  wrong steps between scans of which it says nothing. Peers say nothing.
- **points off 11 planes**, **map accuracy**: of a map of 0.05 m voxels that is made of each contender's poses in the
  same way; the mean distance to the true structure. Off-plane points read 0 at centimetres of drift: look at both.
- Scan to scan, peers begin each registration where nothing has moved, as the original system did; scan to map, KISS-ICP
  and our methods go on at constant velocity. *With prior*, all begin from leg odometry; GenZ-ICP takes none.
- Lengths behind names are voxels. Peers have their own defaults but for the voxel, for which KISS-ICP, GenZ-ICP and
  VGICP have the two that were best for them on a set like the first; Open3D has no default for the distance of pairs
  and has 0.5 m; small_gicp scan to map has 0.3 m. small_gicp's incremental map for GICP cannot be had from Python, so
  its local map is made anew after each scan. PCL is Debian's build.
"""


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
