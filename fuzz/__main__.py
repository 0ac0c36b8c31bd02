"""`python -m fuzz [TARGET ...] --runs N --seed S`: coverage-guided fuzzing of the readers, and a table of what came.

It needs atheris: `make fuzz` installs it. What a reader cannot stand is kept in out/fuzz/TARGET/: give the file to
`python -m fuzz.child TARGET FILE` to see it again.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from fuzz.targets import TARGETS

_OUT = Path("out") / "fuzz"
_MAX_SECONDS_A_RUN = 10
_MAX_RSS_MIB = 2048
_COVERAGE = re.compile(r"cov: (\d+)")
_STATS = re.compile(r"stat::(number_of_executed_units|peak_rss_mb): +(\d+)")


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of one campaign. num_covered: branches that were taken. findings: files with what could not be stood."""

    name: str
    num_runs: int
    num_covered: int
    peak_rss_mib: int
    seconds: float
    findings: tuple[Path, ...]
    exit_code: int

    @property
    def row(self) -> str:
        """For people."""
        found = ", ".join(map(str, self.findings)) or ("-" if self.exit_code == 0 else f"exit code {self.exit_code}")
        numbers = f"{self.num_runs:>10}{self.num_covered:>10}{self.peak_rss_mib:>10}{self.seconds:>8.0f}"
        return f"{self.name:16}{numbers}  {found}"


def main() -> int:
    """Returns 1 if anything was found."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description="Fuzzes the readers, guided by coverage.")
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)}; none: all")
    parser.add_argument("--runs", type=int, default=20_000, help="inputs a target")
    parser.add_argument("--seconds", type=int, default=60, help="a target at most")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    if unknown := [name for name in arguments.targets if name not in TARGETS]:
        parser.error(f"no target {unknown[0]}; targets are {', '.join(TARGETS)}")
    print(f"{'target':16}{'runs':>10}{'branches':>10}{'peak MiB':>10}{'s':>8}  findings")
    outcomes = []
    for name in arguments.targets or TARGETS:
        outcomes.append(campaign(name, arguments.runs, arguments.seconds, arguments.seed))
        print(outcomes[-1].row, flush=True)
    return int(any(outcome.findings or outcome.exit_code for outcome in outcomes))


def campaign(name: str, num_runs: int, max_seconds: int, seed: int) -> Outcome:
    """Fuzzes one target in a process of its own. What it prints is kept beside the findings."""
    folder = _OUT / name
    folder.mkdir(parents=True, exist_ok=True)
    before = set(folder.iterdir())
    options = [
        f"-runs={num_runs}",
        f"-max_total_time={max_seconds}",
        f"-seed={seed}",
        f"-timeout={_MAX_SECONDS_A_RUN}",
        f"-rss_limit_mb={_MAX_RSS_MIB}",
        f"-artifact_prefix={folder}/",
        "-print_final_stats=1",
    ]
    started_s = time.monotonic()
    with tempfile.TemporaryDirectory() as corpus:
        process = subprocess.run(  # noqa: S603 - our own module
            [sys.executable, "-m", "fuzz.child", name, corpus, *options], capture_output=True, text=True, check=False
        )
    seconds = time.monotonic() - started_s
    said = process.stdout + process.stderr
    (folder / "log.txt").write_text(said)
    stats = {key: int(value) for key, value in _STATS.findall(said)}
    return Outcome(
        name,
        stats.get("number_of_executed_units", 0),
        max((int(number) for number in _COVERAGE.findall(said)), default=0),
        stats.get("peak_rss_mb", 0),
        seconds,
        tuple(sorted(path for path in set(folder.iterdir()) - before if path.name != "log.txt")),
        process.returncode,
    )


if __name__ == "__main__":
    sys.exit(main())
