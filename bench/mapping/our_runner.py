"""Runs one of our methods over scans as `peer_runner` runs a peer: the same arguments, the same lines.

`python -m bench.mapping.our_runner SCANS.npz METHOD:SCAN_TO[:refine] VOXEL_M [GUESSES]`. Timed is the facade's whole
work on a scan, from points to odometry and status; what is loaded at the first call of a kernel is loaded beforehand.
With `refine` a last line has the refined poses, and what refining took.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from services.mapper.mapper import Mapper
from services.mapper.priors.interface import Prior
from services.mapper.priors.known_trajectory import KnownTrajectory
from shared.geometry import SE3
from shared.messaging.messages import LidarScan, MapStatus, Odometry
from shared.runtime.config import MapperConfig

_PERIOD_NS = 100_000_000
_NUM_WARM_UP = 3


@dataclass(frozen=True, slots=True)
class Job:
    """What is to be run. guesses: T_previous_scan a scan, None without a prior."""

    scans_m: list[NDArray[np.float32]]
    config: MapperConfig
    guesses: list[SE3] | None
    is_refined: bool


def read_job(arguments: list[str]) -> Job:
    """From the command line."""
    archive = np.load(Path(arguments[0]))
    starts, points_m = archive["starts"], archive["points"]
    scans_m = [points_m[a:b] for a, b in pairwise(starts)]
    method, scan_to, *refine = arguments[1].split(":")
    guesses = None
    if len(arguments) > 3:
        guesses = [SE3.projected(row.reshape(4, 4)) for row in np.loadtxt(arguments[3], ndmin=2)]
    config = MapperConfig.model_validate(
        {
            "method": method,
            "scan_to": scan_to,
            "voxel_size_m": float(arguments[2]),
            "prior": "constant_velocity",
            "map_rate_hz": 1e-6,
        }
    )
    return Job(scans_m, config, guesses, bool(refine))


def run(job: Job, num_scans: int | None = None) -> Mapper:
    """Maps all scans, or the first few without a word."""
    mapper = Mapper(job.config, time.perf_counter_ns, prior=_prior(job.guesses))
    for k, scan_m in enumerate(job.scans_m[:num_scans]):
        scan = message(scan_m, k)
        started, cpu_started = time.perf_counter(), time.process_time()
        said = mapper.add_scan(scan, 0)
        ms, cpu_ms = 1e3 * (time.perf_counter() - started), 1e3 * (time.process_time() - cpu_started)
        if num_scans is None:
            odometry = next((m for m in said if isinstance(m, Odometry)), None)
            status = next(m for m in said if isinstance(m, MapStatus))
            pose = SE3.identity() if odometry is None else SE3.from_xyz_quat_xyzw(odometry.T_frame_child)
            line = {"ms": ms, "cpu_ms": cpu_ms, "pose": pose.matrix.ravel().tolist()}
            print(json.dumps({**line, "is_lost": not status.is_tracking}))
    return mapper


def message(points_m: NDArray[np.float32], k: int) -> LidarScan:
    """Scan k, all of it measured at once."""
    num_points = len(points_m)
    return LidarScan(
        stamp_ns=k * _PERIOD_NS,
        seq=k,
        frame="lidar",
        points_m=points_m,
        intensity=np.zeros(num_points, dtype=np.float32),
        t_ns=np.zeros(num_points, dtype=np.uint32),
        ring=np.zeros(num_points, dtype=np.uint16),
    )


def _prior(guesses: list[SE3] | None) -> Prior | None:
    if guesses is None:
        return None
    poses = [SE3.identity()]
    for step in guesses[1:]:
        poses.append(SE3.projected((poses[-1] @ step).matrix))
    return KnownTrajectory([(k * _PERIOD_NS, pose) for k, pose in enumerate(poses)])


def main() -> None:
    """Runs the job twice: a few scans for nothing, then all."""
    job = read_job(sys.argv[1:])
    run(job, _NUM_WARM_UP)
    run(job)
    print(json.dumps({"peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}))


if __name__ == "__main__":
    main()
