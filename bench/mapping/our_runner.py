"""Runs one of our methods over scans as `peer_runner` runs a peer: the same arguments, the same lines.

`python -m bench.mapping.our_runner SCANS.npz METHOD:SCAN_TO[:refine] VOXEL_M [GUESSES]`. Timed is the facade's whole
work on a scan, from points to odometry and status; what is loaded at the first call of a kernel is loaded beforehand.
With `refine` a last line has the refined poses, and what refining took.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import psutil

from services.mapper.mapper import Mapper, Registered
from services.mapper.priors.interface import Prior
from services.mapper.priors.known_trajectory import KnownTrajectory
from services.mapper.warming import warm_up
from services.mapper.whole_run import refined
from shared.geometry import SE3
from shared.messaging.messages import LidarScan, Odometry
from shared.messaging.scans import scan_of
from shared.runtime.config import MapperConfig


@dataclass(frozen=True, slots=True)
class Job:
    """What is to be run. guesses: T_previous_scan a scan, None without a prior."""

    scans: list[LidarScan]
    config: MapperConfig
    guesses: list[SE3] | None
    is_refined: bool


def read_job(arguments: list[str]) -> Job:
    """From the command line."""
    archive = np.load(Path(arguments[0]))
    points_m, t_ns, rows = archive["points"], archive["t_ns"], pairwise(archive["starts"])
    stamps_ns = archive["stamps_ns"].tolist()
    scans = [scan_of(points_m[a:b], stamps_ns[k], k, t_ns=t_ns[a:b]) for k, (a, b) in enumerate(rows)]
    method, scan_to, *options = arguments[1].split(":")
    guesses = None
    if len(arguments) > 3:
        guesses = [SE3.projected(row.reshape(4, 4)) for row in np.loadtxt(arguments[3], ndmin=2)]
    return Job(scans, _config(method, scan_to, float(arguments[2])), guesses, "refine" in options)


def run(job: Job) -> None:
    """Maps all scans, a line each; then refines if asked to, which is a line more."""
    mapper = Mapper(job.config, time.perf_counter_ns, prior=_prior(job))
    poses, kept = list[SE3](), list[Registered]()
    for scan in job.scans:
        started, cpu_started = time.perf_counter(), time.process_time()
        said = mapper.add_scan(scan, 0)
        ms, cpu_ms = 1e3 * (time.perf_counter() - started), 1e3 * (time.process_time() - cpu_started)
        odometry = next((m for m in said if isinstance(m, Odometry)), None)
        poses.append(SE3.identity() if odometry is None else SE3.from_xyz_quat_xyzw(odometry.T_frame_child))
        assert mapper.last is not None
        if job.is_refined:
            kept.append(mapper.last)
        _say(ms=ms, cpu_ms=cpu_ms, pose=_row_major(poses[-1]), is_lost=not mapper.last.is_tracked)
    if job.is_refined:
        cpu_started = time.process_time()
        whole = refined(kept, mapper.target.matcher, job.config)
        refine_ms = 1e3 * (time.process_time() - cpu_started)
        since_taken = [scan.T_map_sensor.inv() @ pose for scan, pose in zip(kept, poses, strict=True)]
        at_stamps = [pose @ step for pose, step in zip(whole.poses, since_taken, strict=True)]
        _say(refine_ms=refine_ms, refined=[_row_major(pose) for pose in at_stamps])


def _say(**line: object) -> None:
    print(json.dumps(line))


def _row_major(pose: SE3) -> list[float]:
    return [float(value) for value in pose.matrix.ravel()]


def _config(method: str, scan_to: str, voxel_m: float) -> MapperConfig:
    """Without publishing the map. Scan to scan everything is believed, as the peers do."""
    settings: dict[str, object] = {"method": method, "scan_to": scan_to, "voxel_size_m": voxel_m}
    if scan_to == "scan":
        settings |= {"min_score": 1e-6, "max_jump_m": 100.0, "max_jump_deg": 180.0}
    return MapperConfig.model_validate({**settings, "prior": "constant_velocity", "map_rate_hz": 1e-6})


def _prior(job: Job) -> Prior | None:
    if job.guesses is None:
        return None
    poses = [SE3.identity()]
    for step in job.guesses[1:]:
        poses.append(SE3.projected((poses[-1] @ step).matrix))
    return KnownTrajectory([(scan.stamp_ns, pose) for scan, pose in zip(job.scans, poses, strict=True)])


def main() -> None:
    """Warms up, runs the job, and says how much memory that took beyond the scans themselves."""
    job = read_job(sys.argv[1:])
    warm_up(job.config, is_refining=job.is_refined)
    process = psutil.Process()
    before = process.memory_info().rss
    run(job)
    _say(added_rss_mb=(process.memory_info().rss - before) / 2**20)


if __name__ == "__main__":
    main()
