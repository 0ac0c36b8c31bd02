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
    """Gated points (N_k, 3) float32 of each scan in the lidar frame, and stamps and true poses of the scans.

    t_ns: of each point (N_k,) after its scan's stamp. prior: T_start_lidar by other means, used as increments; None
    where there is none.
    """

    directory: Path
    scans_m: tuple[NDArray[np.float32], ...]
    t_ns: tuple[NDArray[np.uint32], ...]
    stamps_ns: tuple[int, ...]
    truth: tuple[SE3, ...]
    prior: tuple[SE3, ...] | None

    @property
    def name(self) -> str:
        """The folder's."""
        return self.directory.name

    def first(self, num_scans: int) -> ScanSet:
        """The same with at most so many scans."""
        some = slice(num_scans)
        prior = None if self.prior is None else self.prior[some]
        return ScanSet(
            self.directory, self.scans_m[some], self.t_ns[some], self.stamps_ns[some], self.truth[some], prior
        )

    def guesses(self) -> NDArray[np.float64] | None:
        """T_previous_scan (K, 16), row-major, by the prior; the first is identity."""
        if self.prior is None:
            return None
        steps = [a.inv() @ b for a, b in pairwise(self.prior)]
        return np.array([T.matrix.ravel() for T in (SE3.identity(), *steps)])


def read_scan_set(directory: Path, range_bias_m: float = 0.0) -> ScanSet:
    """All scans from data0.pcd on; so much is added to every range.

    Raises:
        InputFileError: there are no scans, or not as many poses.
    """
    scans: list[NDArray[np.float32]] = []
    times: list[NDArray[np.uint32]] = []
    while (path := directory / f"data{len(scans)}.pcd").is_file():
        cloud = read_cloud(path)
        points_m = cloud.points_m.astype(np.float32)
        is_near = in_gate(points_m)
        scans.append(shifted(points_m[is_near], range_bias_m))
        times.append(
            np.zeros(is_near.sum(), np.uint32) if cloud.t_ns is None else cloud.t_ns[is_near].astype(np.uint32)
        )
    truth, prior = read_tum(directory / "truth.tum"), directory / "prior.tum"
    if not scans or len(scans) != len(truth):
        raise InputFileError(f"{directory}: {len(scans)} scans, but {len(truth)} poses in truth.tum")
    return ScanSet(
        directory=directory,
        scans_m=tuple(scans),
        t_ns=tuple(times),
        stamps_ns=tuple(stamp_ns for stamp_ns, _ in truth),
        truth=tuple(pose for _, pose in truth),
        prior=tuple(pose for _, pose in read_tum(prior)) if prior.is_file() else None,
    )


def in_gate(points_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which of the points (N, 3) are within the ranges that all get (N,)."""
    range_m = np.linalg.norm(points_m, axis=1)
    is_near: NDArray[np.bool_] = (range_m >= MIN_RANGE_M) & (range_m <= MAX_RANGE_M)
    return is_near


def shifted(points_m: NDArray[np.float32], bias_m: float) -> NDArray[np.float32]:
    """Points (N, 3), none of them at the origin, moved away from it by so much."""
    if bias_m == 0:
        return points_m
    range_m = np.linalg.norm(points_m, axis=1, keepdims=True)
    moved: NDArray[np.float32] = (points_m * (1 + bias_m / range_m)).astype(np.float32)
    return moved


def write_npz(scan_set: ScanSet, path: Path) -> None:
    """The gated scans in one file, as the peers' runner reads them."""
    starts = np.cumsum([0, *(len(scan_m) for scan_m in scan_set.scans_m)])
    points_m, t_ns = np.concatenate(scan_set.scans_m), np.concatenate(scan_set.t_ns)
    np.savez(path, points=points_m, starts=starts, t_ns=t_ns, stamps_ns=np.array(scan_set.stamps_ns, dtype=np.int64))
