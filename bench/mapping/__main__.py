"""Our methods beside PCL, Open3D, small_gicp, KISS-ICP and GenZ-ICP: `python -m bench.mapping`.

Takes folders of data0.pcd ... with truth.tum (and structure.yaml, if it is not the original structure; and prior.tum),
or makes a climb of its own. All get the same points, from 0.5 to 10 m. Contenders run in turn, each in a process of its
own bound to one core, as often as asked for; reading files is not timed. A set with a prior is run with it and without.
Peers that are not installed are named and left out.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bench.mapping.contenders import CONTENDERS, Contender, Launcher
from bench.mapping.data import made_sets
from bench.mapping.machine import machine
from bench.mapping.measuring import Run, RunError, run_once, timing_of
from bench.mapping.scans import ScanSet, read_scan_set, write_npz
from bench.mapping.scoring import num_silent, score, structure_of
from bench.mapping.table import INTRODUCTION, Row, markdown

_CACHE = Path("out") / "bench" / "mapping"


@dataclass(frozen=True, slots=True)
class Case:
    """A set of scans, with its prior or without, as files for the runners."""

    scan_set: ScanSet
    npz: Path
    guesses: Path | None

    @property
    def title(self) -> str:
        """Of its table."""
        return f"{self.scan_set.name}, {'with' if self.guesses else 'without'} prior"


@dataclass(slots=True)
class Results:
    """Of one case: runs by contender, and what went wrong."""

    runs: dict[Contender, list[Run]] = field(default_factory=dict)
    problems: dict[Contender, str] = field(default_factory=dict)


def cases_of(folder: Path) -> list[Case]:
    """Without prior, and with it where there is one."""
    scan_set = read_scan_set(folder)
    _CACHE.mkdir(parents=True, exist_ok=True)
    npz = _CACHE / f"{scan_set.name}.npz"
    write_npz(scan_set, npz)
    guesses = scan_set.guesses()
    if guesses is None:
        return [Case(scan_set, npz, None)]
    path = _CACHE / f"{scan_set.name}.guesses.txt"
    np.savetxt(path, guesses)
    return [Case(scan_set, npz, None), Case(scan_set, npz, path)]


def measure(case: Case, launcher: Launcher, arguments: argparse.Namespace) -> Results:
    """Runs all contenders in turn, so many times; one that failed is not run again."""
    results = Results()
    for number in range(arguments.runs):
        for contender in _chosen(arguments.only):
            if contender in results.problems or (case.guesses and not contender.takes_prior):
                continue
            if (absence := launcher.absence(contender)) is not None:
                results.problems[contender] = absence
                continue
            command = launcher.command(contender, case.scan_set.directory, case.npz, case.guesses)
            print(f"{case.title}: run {number + 1}, {contender.label}", file=sys.stderr)
            try:
                run = run_once(command, arguments.core, arguments.timeout)
                results.runs.setdefault(contender, []).append(run)
            except RunError as error:
                results.problems[contender] = str(error)
    return results


def rows_of(case: Case, results: Results) -> list[Row]:
    """The true poses, then each contender; scores are those of the first run."""
    structure = structure_of(case.scan_set.directory)
    rows = [Row("true poses", score=score(case.scan_set.truth, case.scan_set, structure))]
    for contender, runs in results.runs.items():
        poses = runs[0].refined or runs[0].poses
        if len(poses) != len(case.scan_set.truth):
            rows.append(Row(contender.label, problem=f"{len(poses)} poses for {len(case.scan_set.truth)} scans"))
            continue
        figures, is_lost = score(poses, case.scan_set, structure), runs[0].is_lost
        lost = (None, None) if is_lost is None else (sum(is_lost), num_silent(poses, case.scan_set.truth, is_lost))
        rows.append(Row(contender.label, timing_of(runs), figures, *lost))
    return [*rows, *(Row(contender.label, problem=why) for contender, why in results.problems.items())]


def _chosen(only: str | None) -> list[Contender]:
    return [contender for contender in CONTENDERS if only is None or only in f"{contender.family} {contender.label}"]


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.mapping", description=__doc__)
    parser.add_argument("--data", type=Path, action="append", help="a folder of scans; may be given several times")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--only", help="contenders whose family or label has this in it")
    parser.add_argument("--peers-python", type=Path, default=Path(sys.executable), help="an interpreter with the peers")
    parser.add_argument("--core", type=int, default=max(os.sched_getaffinity(0)), help="all run on this one")
    parser.add_argument("--timeout", type=float, default=300.0, help="seconds that one run may take")
    parser.add_argument("--json", type=Path, help="file for all figures")
    parser.add_argument("--markdown", type=Path, help="file for the tables")
    return parser.parse_args()


def main() -> None:
    """Measures and prints tables; writes them and all figures where asked."""
    arguments = _parse()
    launcher, document, tables = Launcher(arguments.peers_python), [], []
    about = machine([launcher.version(c) for c in _chosen(arguments.only) if not c.is_ours and not launcher.absence(c)])
    for folder in arguments.data or made_sets(_CACHE / "data"):
        for case in cases_of(folder):
            rows = rows_of(case, measure(case, launcher, arguments))
            tables.append(f"## {case.title}\n\n{markdown(rows)}")
            entry: dict[str, Any] = {"case": case.title, "num_scans": len(case.scan_set.truth)}
            document.append({**entry, "rows": [asdict(row) for row in rows]})
            print(tables[-1], flush=True)
            _write(arguments, about, document, tables)


def _write(arguments: argparse.Namespace, about: dict[str, str], document: list[Any], tables: list[str]) -> None:
    if arguments.json:
        arguments.json.write_text(
            json.dumps({"about": about, "runs": arguments.runs, "cases": document}, indent=1) + "\n"
        )
    if arguments.markdown:
        lines = "\n".join(f"- {name}: {value}" for name, value in {**about, "runs": str(arguments.runs)}.items())
        text = f"# The mapper beside its peers\n\n{INTRODUCTION}\n{lines}\n\n" + "\n".join(tables)
        arguments.markdown.write_text(text)


if __name__ == "__main__":
    main()
