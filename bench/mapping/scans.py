"""Scans in a folder of data0.pcd ... with truth.tum and perhaps prior.tum and structure.yaml, as benches take them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared.cloud_files import read_cloud
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.trajectory_files import read_tum

MIN_RANGE_M, MAX_RANGE_M = 0.5, 10.0
"""What everybody gets: beyond the robot's own reach, up to the original's range."""


@dataclass(frozen=True, slots=True)
class ScanSet:
    """Gated points (N_k, 3) float32 of each scan in the lidar frame, and poses a scan.

    prior: T_start_lidar by other means, used as increments; None where there is none.
    """

    directory: Path
    scans_m: tuple[NDArray[np.float32], ...]
    truth: tuple[SE3, ...]
    prior: tuple[SE3, ...] | None

    @property
    def name(self) -> str:
        """The folder's."""
        return self.directory.name

    def guesses(self) -> NDArray[np.float64] | None:
        """T_previous_scan (K, 16), row-major, by the prior; the first is identity."""
        if self.prior is None:
            return None
        steps = [a.inv() @ b for a, b in pairwise(self.prior)]
        return np.array([T.matrix.ravel() for T in (SE3.identity(), *steps)])


def read_scan_set(directory: Path) -> ScanSet:
    """All scans from data0.pcd on.

    Raises:
        InputFileError: there are no scans, or not as many poses.
    """
    scans: list[NDArray[np.float32]] = []
    while (path := directory / f"data{len(scans)}.pcd").is_file():
        scans.append(gated(read_cloud(path).points_m.astype(np.float32)))
    truth, prior = _read_poses(directory / "truth.tum"), directory / "prior.tum"
    if not scans or len(scans) != len(truth):
        raise InputFileError(f"{directory}: {len(scans)} scans, but {len(truth)} poses in truth.tum")
    return ScanSet(directory, tuple(scans), truth, _read_poses(prior) if prior.is_file() else None)


def gated(points_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """The points (N, 3) within the ranges that all get."""
    range_m = np.linalg.norm(points_m, axis=1)
    near: NDArray[np.float32] = points_m[(range_m >= MIN_RANGE_M) & (range_m <= MAX_RANGE_M)]
    return near


def write_npz(scan_set: ScanSet, path: Path) -> None:
    """The gated scans in one file, as the peers' runner reads them."""
    starts = np.cumsum([0, *(len(scan_m) for scan_m in scan_set.scans_m)])
    np.savez(path, points=np.concatenate(scan_set.scans_m), starts=starts)


def _read_poses(path: Path) -> tuple[SE3, ...]:
    return tuple(pose for _, pose in read_tum(path))
