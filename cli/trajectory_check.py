"""Judges a trajectory file offline, a row at a time, and prints what it finds."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer

from services.player.trajectory import ChangeFoot, read_trajectory
from shared.climbing.climb_check import ClimbCheck, Row, RowReport
from shared.climbing.climber import load_climber
from shared.climbing.stance import Stance
from shared.geometry import SE3
from shared.messaging.messages import JOINT_NAMES
from shared.runtime.config import Config
from shared.runtime.exit_codes import Exit

_WHAT = {"start": "start on {}", "move": "move {}", "change": "fix {}"}


def initial_stance(config: Config) -> Stance:
    """Where the simulation starts: joints at zero, the fixed foot where the configuration puts it."""
    sim = config.sim
    T_world_foot = SE3.from_rpy(np.deg2rad(sim.initial_foot_rpy_deg), sim.initial_foot_xyz_m)
    return Stance(sim.initial_foot, T_world_foot)


def check_trajectory(path: Path, config: Config) -> list[RowReport]:
    """The reports of a file's rows, on the structure of the configuration, from where its simulation starts.

    Raises:
        InputFileError, ConfigError: the trajectory, the robot or the structure is not usable.
    """
    rows = [Row(move.line, None if isinstance(move, ChangeFoot) else move.q) for move in read_trajectory(path)]
    return list(ClimbCheck(load_climber(config)).reports(rows, initial_stance(config), np.zeros(len(JOINT_NAMES))))


def print_reports(reports: Sequence[RowReport], *, is_json: bool) -> Exit:
    """Writes them to stdout; returns 3 where any row is bad."""
    num_bad = sum(bool(report.problems) for report in reports)
    if is_json:
        typer.echo(json.dumps({"summary": summary(reports), "rows": [_plain(report) for report in reports]}, indent=2))
    else:
        typer.echo(f"{'line':>4}  {'row':<10} {'cut mm':>7} {'gap mm':>7} {'tilt deg':>8} {'margin':>6}  verdict")
        for report in reports:
            typer.echo(_line(report))
        typer.echo(_summary_text(summary(reports)))
    return Exit.PARTIAL if num_bad else Exit.FINE


def summary(reports: Sequence[RowReport]) -> dict[str, Any]:
    """The worst of every figure; None where there is none to tell."""
    landings = [report.landing for report in reports if report.landing is not None]
    met = [landing for landing in landings if landing.coverage]
    return {
        "num_moves": sum(report.kind == "move" for report in reports),
        "num_landings": sum(report.kind == "move" and report.landing is not None for report in reports),
        "num_bad_rows": sum(bool(report.problems) for report in reports),
        "max_depth_mm": max((_depth_mm(report) for report in reports), default=0.0),
        "max_gap_mm": max((1e3 * abs(landing.gap_m) for landing in met), default=None),
        "max_tilt_deg": max((math.degrees(landing.angle_rad) for landing in met), default=None),
        "num_landings_in_the_air": len(landings) - len(met),
        "min_margin": min((report.margin for report in reports if report.margin is not None), default=None),
    }


def _depth_mm(report: RowReport) -> float:
    return 0.0 if report.cut is None else 1e3 * report.cut.depth_m


def _line(report: RowReport) -> str:
    what = _WHAT[report.kind].format(report.foot.value)
    depth = f"{_depth_mm(report):.2f}" if report.kind == "move" else ""
    gap = tilt = ""
    if (landing := report.landing) is not None:
        gap = f"{round(1e3 * landing.gap_m, 2) + 0.0:.2f}" if landing.coverage else "-"
        tilt = f"{math.degrees(landing.angle_rad):.2f}" if landing.coverage else "-"
    margin = "" if report.margin is None else f"{report.margin:.2f}"
    verdict = "BAD: " + "; ".join(report.problems) if report.problems else "fine"
    line = report.line or ""
    return f"{line:>4}  {what:<10} {depth:>7} {gap:>7} {tilt:>8} {margin:>6}  {verdict}"


def _summary_text(figures: dict[str, Any]) -> str:
    parts = [f"{figures['num_moves']} moves, {figures['num_landings']} landings"]
    parts.append(f"deepest cut {figures['max_depth_mm']:.2f} mm")
    if figures["max_gap_mm"] is not None:
        parts.append(f"worst landing {figures['max_gap_mm']:.2f} mm, {figures['max_tilt_deg']:.2f} deg")
    if figures["num_landings_in_the_air"]:
        parts.append(f"{figures['num_landings_in_the_air']} landings in the air")
    if figures["min_margin"] is not None:
        parts.append(f"least holding margin {figures['min_margin']:.2f}")
    bad = figures["num_bad_rows"]
    return "; ".join(parts) + (f"; {bad} row{'s are' if bad > 1 else ' is'} BAD" if bad else "; every row is fine")


def _plain(report: RowReport) -> dict[str, Any]:
    cut, landing = report.cut, report.landing
    is_met = landing is not None and landing.coverage > 0
    return {
        "line": report.line,
        "kind": report.kind,
        "foot": report.foot.value,
        "beyond_limits": list(report.limits),
        "cut": cut and {"depth_mm": _depth_mm(report), "share": cut.share, "link": cut.link, "other": cut.other},
        "landing": landing
        and {
            "gap_mm": 1e3 * landing.gap_m if is_met else None,
            "tilt_deg": math.degrees(landing.angle_rad) if is_met else None,
            "coverage": landing.coverage,
            "members": list(landing.members),
            "distance_mm": 1e3 * landing.distance_m if math.isfinite(landing.distance_m) else None,
        },
        "margin": report.margin,
        "problems": list(report.problems),
    }
