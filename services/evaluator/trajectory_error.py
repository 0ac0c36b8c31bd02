"""Errors of an estimated trajectory against the true one.

ATE and RPE as in Sturm et al., IROS 2012, section V; RPE by distance as in Geiger et al., CVPR 2012, section 4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.evaluator.state import ComparisonState, PairState
from shared.geometry import SE3

Float = NDArray[np.float64]

PAIR_OK_M = 0.05
PAIR_OK_RAD = math.radians(1.0)
"""A step between two scans counts as right within these: half a scan's error of the methods that were published."""
SEGMENT_LENGTHS_M = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)


@dataclass(frozen=True, slots=True)
class TrajectoryError:
    """ate_*: of each pose, after the trajectories were laid together. rpe_*: of each step between two poses.

    num_pairs: steps; pairs_ok: those within PAIR_OK_M and PAIR_OK_RAD. drift_m: of the last position, with the first
    poses laid together. path_m: length of the true path; drift_share: drift_m of it, None where nothing moved.
    """

    num_poses: int
    ate_rmse_m: float
    ate_mean_m: float
    ate_max_m: float
    ate_rot_rmse_rad: float
    rpe_rmse_m: float
    rpe_rmse_rad: float
    num_pairs: int
    pairs_ok: int
    drift_m: float
    path_m: float

    @property
    def drift_share(self) -> float | None:
        """Drift in metres a metre of the true path."""
        return self.drift_m / self.path_m if self.path_m > 0 else None


@dataclass(frozen=True, slots=True)
class SegmentError:
    """Errors of the relative pose over parts of the path of one length, from every pose from which one begins."""

    length_m: float
    num_segments: int
    rmse_m: float
    rmse_rad: float


@dataclass(slots=True)
class _Sums:
    """Of errors in metres and radians, over however many were added."""

    num: int = 0
    metres: float = 0.0
    squared_m: float = 0.0
    squared_rad: float = 0.0
    max_m: float = 0.0

    def add(self, error: SE3) -> tuple[float, float]:
        length_m, angle_rad = float(np.linalg.norm(error.translation)), error.angle_rad
        self.num += 1
        self.metres += length_m
        self.squared_m += length_m**2
        self.squared_rad += angle_rad**2
        self.max_m = max(self.max_m, length_m)
        return length_m, angle_rad

    def snapshot(self) -> Float:
        return np.array([self.num, self.metres, self.squared_m, self.squared_rad, self.max_m])

    @classmethod
    def restored(cls, values: Float) -> _Sums:
        num, *sums = values.tolist()
        return cls(int(num), *sums)

    def rmse(self) -> tuple[float, float]:
        """In metres and radians, 0 of nothing."""
        num = max(self.num, 1)
        return math.sqrt(self.squared_m / num), math.sqrt(self.squared_rad / num)


class TrajectoryComparison:
    """Compares pose by pose, online: `add` takes T_map_lidar as estimated and T_world_lidar as true at one time.

    Unless T_world_map is given, the first pair lays the map frame on the world, so that drift shows.
    """

    def __init__(self, T_world_map: SE3 | None = None) -> None:
        self.T_world_map = T_world_map
        self._first: tuple[SE3, SE3] | None = None
        self._previous: tuple[SE3, SE3] | None = None
        self._poses, self._steps = _Sums(), _Sums()
        self._pairs_ok = 0
        self._path_m = 0.0

    def add(self, T_map_lidar: SE3, T_world_lidar: SE3) -> SE3:
        """Takes one pair; returns what is left between estimate and truth, in the lidar's frame."""
        if self.T_world_map is None:
            self.T_world_map = T_world_lidar @ T_map_lidar.inv()
        error = T_world_lidar.inv() @ (self.T_world_map @ T_map_lidar)
        self._poses.add(error)
        pair = T_map_lidar, T_world_lidar
        if self._previous is None:
            self._first = pair
        else:
            length_m, angle_rad = self._steps.add(_relative_error(self._previous, pair))
            self._pairs_ok += length_m <= PAIR_OK_M and angle_rad <= PAIR_OK_RAD
            self._path_m += float(np.linalg.norm(T_world_lidar.translation - self._previous[1].translation))
        self._previous = pair
        return error

    def snapshot(self) -> ComparisonState | None:
        """What `restore` needs; None before the first pair."""
        if self.T_world_map is None or self._first is None or self._previous is None:
            return None
        return ComparisonState(
            T_world_map=self.T_world_map.matrix,
            first=_pair_state(self._first),
            previous=_pair_state(self._previous),
            poses=self._poses.snapshot(),
            steps=self._steps.snapshot(),
            pairs_ok=self._pairs_ok,
            path_m=self._path_m,
        )

    def restore(self, state: ComparisonState) -> None:
        """Goes on from there.

        Raises:
            ValueError: a matrix is no pose.
        """
        self.T_world_map = SE3.from_matrix(state.T_world_map)
        self._first, self._previous = _pair(state.first), _pair(state.previous)
        self._poses, self._steps = _Sums.restored(state.poses), _Sums.restored(state.steps)
        self._pairs_ok, self._path_m = state.pairs_ok, state.path_m

    def result(self) -> TrajectoryError:
        """The figures so far.

        Raises:
            ValueError: nothing was added yet.
        """
        if self._first is None or self._previous is None:
            raise ValueError("no poses to compare")
        ate_rmse_m, ate_rot_rmse_rad = self._poses.rmse()
        rpe_rmse_m, rpe_rmse_rad = self._steps.rmse()
        drift = _relative_error(self._first, self._previous)
        return TrajectoryError(
            num_poses=self._poses.num,
            ate_rmse_m=ate_rmse_m,
            ate_mean_m=self._poses.metres / self._poses.num,
            ate_max_m=self._poses.max_m,
            ate_rot_rmse_rad=ate_rot_rmse_rad,
            rpe_rmse_m=rpe_rmse_m,
            rpe_rmse_rad=rpe_rmse_rad,
            num_pairs=self._steps.num,
            pairs_ok=self._pairs_ok,
            drift_m=float(np.linalg.norm(drift.translation)),
            path_m=self._path_m,
        )


def compare_trajectories(
    T_map_lidar: Sequence[SE3], T_world_lidar: Sequence[SE3], T_world_map: SE3 | None = None
) -> TrajectoryError:
    """The figures of whole trajectories, pose k against pose k; without T_world_map the first poses are laid together.

    Raises:
        ValueError: no poses, or not as many of one as of the other.
    """
    comparison = TrajectoryComparison(T_world_map)
    for estimated, true in zip(T_map_lidar, T_world_lidar, strict=True):
        comparison.add(estimated, true)
    return comparison.result()


def errors_by_distance(
    T_map_lidar: Sequence[SE3], T_world_lidar: Sequence[SE3], lengths_m: Sequence[float] = SEGMENT_LENGTHS_M
) -> list[SegmentError]:
    """RPE over parts of the true path that are at least as long as each length; lengths the path has not are left out.

    A part ends at the first pose that is so far along the path from the pose in which it begins.
    """
    true, estimated = _matrices(T_world_lidar), _matrices(T_map_lidar)
    steps_m = np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1)
    along_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    errors = []
    for length_m in lengths_m:
        ends = np.searchsorted(along_m, along_m + length_m * (1 - 1e-12))
        starts = np.flatnonzero(ends < len(along_m))
        if len(starts):
            error = _steps(true, starts, ends[starts], inverse=True) @ _steps(estimated, starts, ends[starts])
            lengths, angles = np.linalg.norm(error[:, :3, 3], axis=1), _angles_rad(error)
            errors.append(SegmentError(length_m, len(starts), _rms(lengths), _rms(angles)))
    return errors


def _pair_state(pair: tuple[SE3, SE3]) -> PairState:
    return PairState(T_map_lidar=pair[0].matrix, T_world_lidar=pair[1].matrix)


def _pair(state: PairState) -> tuple[SE3, SE3]:
    return SE3.from_matrix(state.T_map_lidar), SE3.from_matrix(state.T_world_lidar)


def _relative_error(start: tuple[SE3, SE3], end: tuple[SE3, SE3]) -> SE3:
    """What the estimated step from start to end misses the true one by; each (estimated, true)."""
    return (start[1].inv() @ end[1]).inv() @ (start[0].inv() @ end[0])


def _matrices(poses: Sequence[SE3]) -> Float:
    return np.array([pose.matrix for pose in poses]).reshape(-1, 4, 4)


def _steps(poses: Float, starts: NDArray[np.int64], ends: NDArray[np.int64], *, inverse: bool = False) -> Float:
    """T_start_end (N, 4, 4) of each step, or T_end_start."""
    a, b = (ends, starts) if inverse else (starts, ends)
    T_a_b: Float = np.linalg.inv(poses[a]) @ poses[b]
    return T_a_b


def _angles_rad(poses: Float) -> Float:
    """Rotation angles: the Frobenius norm of R - I is sqrt(8) sin(angle / 2), which is exact for small ones too."""
    distances = np.linalg.norm(poses[:, :3, :3] - np.eye(3), axis=(1, 2))
    angles: Float = 2 * np.arcsin(np.clip(distances / math.sqrt(8), 0, 1))
    return angles


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2)))
