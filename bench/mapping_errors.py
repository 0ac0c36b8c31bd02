"""How far the mapper degrades where sensors are not ideal, and how it grows: `python -m bench.mapping_errors`.

The same part of a climb, 36 s at twice the demo's speed, scanned at 10 Hz: as the original sensor sees it; with a pose
a column (bent scans); with beams of finite width (mixed pixels); with 1 cm added to every range; with all of these and
the datasheet's other errors. Bent scans once more at four times the demo's speed. Then a generated crossed truss turned
by odd angles, and a climb in 75 and 750 scans. There is no prior but constant velocity.
Figures are of one run of each; poses are compared at the beginning of each scan.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from bench.mapping.contenders import CONTENDERS, Contender, Launcher
from bench.mapping.machine import machine
from bench.mapping.measuring import Run, RunError, run_once, timing_of
from bench.mapping.scans import ScanSet, read_scan_set, write_npz
from bench.mapping.scoring import num_pairs_ok, num_silent
from services.evaluator.trajectory_error import compare_trajectories
from shared.runtime.config import CONFIGS_DIR

_CACHE = Path("out") / "bench" / "mapping_errors"
_KEYS = ("plane:map", "plane:map:refine", "gicp:map")
_VOXEL_M = 0.05
_TRAJECTORIES = CONFIGS_DIR / "trajectories"
_TWICE = ["cli.main", "simulate", str(_TRAJECTORIES / "bar_to_post.csv"), "--set", "player.rate_hz=18"]
_FOUR_TIMES = ["cli.main", "simulate", str(_TRAJECTORIES / "bar_to_post.csv"), "--set", "player.rate_hz=36"]
_CLIMB = ["cli.main", "simulate", str(_TRAJECTORIES / "climb.csv")]
_BENT = ["--set", "sensors.lidar.rolling_shutter=true"]
_WIDE = [*("--set", "sensors.lidar.exit_m=0.01"), *("--set", "sensors.lidar.divergence_deg=0.18")]
_REAL = [*("--set", "sensors.lidar.preset=datasheet")]
_TURN = [*("--structure", "crossed"), *("--turn", "11", "-7", "23"), *("--middle", "1", "1", "3")]


@dataclass(frozen=True, slots=True)
class Case:
    """A set of scans: what makes it, a module and its arguments but for the folder, and what is added to its ranges.

    max_scans: only so many are taken from its beginning.
    """

    title: str
    folder: str
    make: list[str]
    bias_m: float = 0.0
    max_scans: int = 360


CASES = (
    Case("original sensor", "plain", _TWICE),
    Case("bent scans", "bent", [*_TWICE, *_BENT]),
    Case("bent scans, four times the demo's speed", "bent4", [*_FOUR_TIMES, *_BENT]),
    Case("mixed pixels", "wide", [*_TWICE, *_WIDE]),
    Case("range bias of 1 cm", "plain", _TWICE, 0.01),
    Case("bent scans, mixed pixels, 1 cm bias", "bent_wide", [*_TWICE, *_BENT, *_WIDE], 0.01),
    Case("preset datasheet", "datasheet", [*_TWICE, *_REAL]),
    Case("preset datasheet, 1 cm bias", "datasheet", [*_TWICE, *_REAL], 0.01),
    Case(
        "crossed truss turned by 11, -7, 23 degrees",
        "truss",
        ["bench.scan_data", *_TURN, *("--reach", "0.35", "0.35", "1.6"), *("--seed", "5")],
    ),
    Case("climb, 75 scans", "climb75", [*_CLIMB, "--scans", "75"]),
    Case("climb, 750 scans", "climb750", [*_CLIMB, "--scans", "750"], max_scans=750),
)


@dataclass(frozen=True, slots=True)
class Row:
    """Of one case and method. problem: why there are no figures."""

    case: str
    method: str
    num_scans: int
    ate_mm: float | None = None
    rpe_mm: float | None = None
    num_pairs_ok: int | None = None
    num_lost: int | None = None
    num_silent: int | None = None
    ms_p50: float | None = None
    ms_p99: float | None = None
    added_rss_mb: float | None = None
    problem: str = ""


def folder_of(case: Case, cache: Path) -> Path:
    """Where the case's scans are; they are made if they are not there yet."""
    folder = cache / case.folder
    if not (folder / "truth.tum").is_file():
        place = ["--out", str(folder)] if case.make[0] == "cli.main" else [str(folder)]
        subprocess.run([sys.executable, "-m", *case.make, *place], check=True)  # noqa: S603 - our own modules
    return folder


def measured(case: Case, contender: Contender, scan_set: ScanSet, command: list[str], core: int) -> Row:
    """One run."""
    try:
        run = run_once(command, core, timeout_s=600.0)
    except RunError as error:
        return Row(case.title, contender.key, len(scan_set.truth), problem=str(error))
    return row_of(case.title, contender.key, scan_set, run)


def row_of(title: str, method: str, scan_set: ScanSet, run: Run) -> Row:
    """Its figures, of the refined poses where there are any."""
    poses, timing = run.refined or run.poses, timing_of([run])
    error = compare_trajectories(poses, scan_set.truth)
    return Row(
        case=title,
        method=method,
        num_scans=len(poses),
        ate_mm=1e3 * error.ate_rmse_m,
        rpe_mm=1e3 * error.rpe_rmse_m,
        num_pairs_ok=num_pairs_ok(poses, scan_set.truth),
        num_lost=sum(run.is_lost or ()),
        num_silent=num_silent(poses, scan_set.truth, run.is_lost or (False,) * len(poses)),
        ms_p50=timing.ms_p50,
        ms_p99=timing.ms_p99,
        added_rss_mb=run.added_rss_mb,
    )


def markdown(rows: list[Row]) -> str:
    """A line a case and method."""
    lines = [
        "| | method | scans | ATE mm | RPE mm | pairs right | lost / wrong unsaid | ms p50 / p99 | memory added MB |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        start = f"| {row.case} | {row.method} | {row.num_scans} |"
        if row.ate_mm is None:
            lines.append(f"{start} {row.problem} | | | | | |")
            continue
        lines.append(
            f"{start} {row.ate_mm:.2f} | {row.rpe_mm:.2f} | {row.num_pairs_ok} of {row.num_scans - 1} "
            f"| {row.num_lost} / {row.num_silent} | {row.ms_p50:.2f} / {row.ms_p99:.2f} | {row.added_rss_mb or 0:.0f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measures and prints a table; writes it and the figures where asked."""
    parser = argparse.ArgumentParser(prog="python -m bench.mapping_errors", description=__doc__)
    parser.add_argument("--only", nargs="+", default=[""], help="cases whose title has one of these in it")
    parser.add_argument("--core", type=int, default=0, help="all run on this one")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--markdown", type=Path)
    arguments = parser.parse_args()
    launcher, rows = Launcher(Path(sys.executable)), list[Row]()
    contenders = [each for key in _KEYS for each in CONTENDERS if (each.key, each.voxel_m) == (key, _VOXEL_M)]
    for case in (case for case in CASES if any(word in case.title for word in arguments.only)):
        scan_set = read_scan_set(folder_of(case, _CACHE), case.bias_m).first(case.max_scans)
        npz = _CACHE / "scans.npz"
        write_npz(scan_set, npz)
        for contender in contenders:
            command = launcher.command(contender, scan_set.directory, npz, None)
            rows.append(measured(case, contender, scan_set, command, arguments.core))
            print(rows[-1], file=sys.stderr)
    table = f"# The mapper where sensors err\n\n{_about()}\n\n{markdown(rows)}"
    print(table)
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    if arguments.markdown:
        arguments.markdown.write_text(table)


def _about() -> str:
    return f"`python -m bench.mapping_errors`; {machine([])['machine']}; one thread, one run of each."


if __name__ == "__main__":
    main()
