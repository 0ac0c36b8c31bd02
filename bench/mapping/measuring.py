"""Runs contenders in turn, each in a process of its own on one core, and keeps what they say."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.mapping.queueing import num_dropped
from shared.geometry import SE3

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
_RATES_HZ = (10.0, 20.0)


class RunError(Exception):
    """A contender's process ended with an error, or said something else than lines of scans."""


@dataclass(frozen=True, slots=True)
class Run:
    """One run over K scans: wall and CPU milliseconds (K,) a scan, poses of the scans in the frame of the first.

    is_lost: whether the contender itself says so, of each scan; None where it says nothing. added_rss_mb: memory that
    ours took beyond the scans.
    refined and refine_ms: poses of the whole run after refining, and what that took.
    """

    ms: tuple[float, ...]
    cpu_ms: tuple[float, ...]
    poses: tuple[SE3, ...]
    is_lost: tuple[bool, ...] | None = None
    added_rss_mb: float | None = None
    refined: tuple[SE3, ...] | None = None
    refine_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class Timing:
    """Over several runs, without each run's first scan, which only begins the map.

    Milliseconds of CPU, which on one core and one thread are those of an idle machine: medians of the runs' means,
    medians and 99th percentiles. wall_ms_mean: the same of wall time, with whatever else the machine did. num_dropped:
    scans missed when they arrive at 10 and 20 Hz, by the median of each scan's CPU time.
    """

    ms_mean: float
    ms_p50: float
    ms_p99: float
    wall_ms_mean: float
    num_dropped_10hz: int
    num_dropped_20hz: int


def run_once(command: Sequence[str], core: int, timeout_s: float) -> Run:
    """Starts a contender on that core and reads its lines.

    Raises:
        RunError: it failed, or took longer.
    """
    try:
        done = subprocess.run(  # noqa: S603 - our own command lines
            command,
            capture_output=True,
            text=True,
            check=False,
            timeout=timeout_s,
            env={**os.environ, **ONE_THREAD},
            preexec_fn=lambda: os.sched_setaffinity(0, {core}),
        )
    except subprocess.TimeoutExpired as error:
        raise RunError(f"took longer than {timeout_s:g} s") from error
    except OSError as error:
        raise RunError(str(error)) from error
    if done.returncode != 0:
        last = (done.stderr.strip() or done.stdout.strip() or "no word").splitlines()[-1]
        raise RunError(f"exit code {done.returncode}: {last}")
    return parse_run(done.stdout)


def parse_run(text: str) -> Run:
    """From the lines of a runner: one a scan, then perhaps what else it says.

    Raises:
        RunError: there is no line of a scan, or one is not JSON or not a pose.
    """
    try:
        lines: list[dict[str, Any]] = [json.loads(line) for line in text.splitlines() if line.startswith("{")]
        scans = [line for line in lines if "pose" in line]
        poses = tuple(_pose(line["pose"]) for line in scans)
        rest = {name: value for line in lines if "pose" not in line for name, value in line.items()}
        refined = tuple(_pose(pose) for pose in rest["refined"]) if "refined" in rest else None
    except (ValueError, KeyError, np.linalg.LinAlgError) as error:
        raise RunError(f"what it says cannot be read: {error}") from error
    if not poses:
        raise RunError("it says nothing of any scan")
    lost = tuple(bool(line["is_lost"]) for line in scans if "is_lost" in line)
    return Run(
        ms=tuple(line["ms"] for line in scans),
        cpu_ms=tuple(line["cpu_ms"] for line in scans),
        poses=poses,
        is_lost=lost or None,
        added_rss_mb=rest.get("added_rss_mb"),
        refined=refined,
        refine_ms=rest.get("refine_ms", 0.0),
    )


def timing_of(runs: Sequence[Run]) -> Timing:
    """Medians over the runs. What refining took is shared out over the scans of a run."""
    added = np.array([[run.refine_ms / len(run.ms)] for run in runs])
    wall_ms, ms = np.array([run.ms for run in runs]) + added, np.array([run.cpu_ms for run in runs]) + added
    each = np.median(ms, axis=0)
    wall_ms, ms = wall_ms[:, 1:], ms[:, 1:]
    dropped = [num_dropped(each.tolist(), 1e3 / rate_hz) for rate_hz in _RATES_HZ]
    return Timing(
        ms_mean=float(np.median(ms.mean(axis=1))),
        ms_p50=float(np.median(np.percentile(ms, 50, axis=1))),
        ms_p99=float(np.median(np.percentile(ms, 99, axis=1))),
        wall_ms_mean=float(np.median(wall_ms.mean(axis=1))),
        num_dropped_10hz=dropped[0],
        num_dropped_20hz=dropped[1],
    )


def _pose(values: list[float]) -> SE3:
    return SE3.projected(np.array(values, dtype=np.float64).reshape(4, 4))
