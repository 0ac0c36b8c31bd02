"""The method `plane`: scans are aligned to patches of plane, which are tracked by their moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.alignment import Counts, Target, approach, finish
from services.mapper.planes.association import Association, associate, room_for
from services.mapper.planes.gauss_newton import normal_sums
from services.mapper.planes.growth import first_map, take_in
from services.mapper.planes.noise import sigma_by_range
from services.mapper.planes.order import in_order
from services.mapper.planes.patches import Patches, PatchMap
from services.mapper.planes.runs import Runs, cut_runs
from services.mapper.planes.search import Reach, candidates, candidates_anywhere, is_same_place, pieces_of
from services.mapper.registration import Points, RegistrationResult
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

Float = NDArray[np.float64]

_GATE_M = 0.05
"""Half the width of the narrowest face: a wider first gate takes points to the other face of a bar, and stays there."""
_SEARCH_GATE_M = 0.1
_SCORE_TOLERANCE = 0.06
"""A score so far below the usual is looked into: right ones vary by less."""
_SHARE_OF_USUAL = 0.6
"""A scan of which so much less than usual is explained may hang on a few patches: its score is lowered."""
_FORGETTING = 0.2
_SLIP_M = 0.025
"""Two poses farther apart are two answers."""
_RIVAL_MARGIN = 0.02
_SEARCH_ANGLE_RAD = np.radians(80.0)
_SEARCH_RADIUS_M = 0.3
_MAX_POSES = 600
_LEAST_SCORE = 0.5
_NOISE_SCANS = 64


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A pose (3, 4), and its score."""

    score: float
    T: Float


@dataclass(slots=True, eq=False)
class _Found:
    """A scan that was aligned, until it is accepted or another comes."""

    points_m: Points
    runs: Runs
    association: Association
    T: Float
    score: float
    share: float


class PlaneMatcher:
    """Finds scans in a map of plane patches (`ScanMatcher`)."""

    def __init__(self, config: MapperConfig) -> None:
        self._config = config
        self._map: PatchMap | None = None
        self._found: _Found | None = None
        self._num_scans = 0
        self._usual_score = self._usual_share = 0.0

    @property
    def patch_map(self) -> PatchMap:
        """The map itself, as whole-run refinement takes it."""
        assert self._map is not None, "start the matcher first"
        return self._map

    @property
    def patches(self) -> Patches:
        """The patches as they are now."""
        return self.patch_map.snapshot

    def start(self, points_lidar_m: Points, T_map_lidar: SE3) -> None:
        """Begins an empty map with this scan, which is where it is said to be.

        Raises:
            RegistrationError: the scan shows fewer than three patches of plane.
        """
        self._map, counts = first_map(points_lidar_m, _rows(T_map_lidar), self._config)
        self._found = None
        self._usual_share = counts.num_explained / max(counts.num_points, 1)
        self._usual_score = _agreement(counts) - 0.5 * _SCORE_TOLERANCE
        self._num_scans = 1

    def align(self, points_lidar_m: Points, guesses: Sequence[SE3], widening: float) -> RegistrationResult:
        """The best place of a scan near the guesses of T_map_lidar, the most likely first; searches wider as needed."""
        runs, association = self._prepared(points_lidar_m)
        poses = [_rows(guess) for guess in guesses]
        best, is_suspect = self._follow(runs, poses[0], _GATE_M, association), False
        if best.score < self._good_score:
            pieces = pieces_of(runs, self.patch_map.voxel_m)
            reach = Reach(_SEARCH_ANGLE_RAD * widening, _SEARCH_RADIUS_M * widening, _MAX_POSES)
            found = candidates(runs, pieces, poses, reach, self._target, self.patch_map.num_patches)
            best, is_suspect = self._best_of([best], found, runs, association)
        return self._finished(points_lidar_m, runs, best, is_suspect, association)

    def accept(self, T_map_lidar: SE3) -> None:
        """The scan aligned last was here: takes what it shows into the map."""
        assert self._found is not None, "align a scan first"
        found, T = self._found, _rows(T_map_lidar)
        if self._config.scan_to == "scan":
            self.start(found.points_m, T_map_lidar)
            return
        self._found = None
        if np.abs(T - found.T).max() > 1e-6:
            associate(found.runs, 1, T, self.patch_map.narrow, self.patch_map.arrays.planes, found.association)
        take_in(self.patch_map, found.runs, T, found.association)
        self._learn(found)

    def localise(self, points_lidar_m: Points) -> RegistrationResult | None:
        """The best place of a scan anywhere in the map, from no guess; None where nothing fits."""
        runs, association = self._prepared(points_lidar_m)
        pieces = pieces_of(runs, self.patch_map.voxel_m)
        found = candidates_anywhere(runs, pieces, self._target, self.patch_map.num_patches)
        best, is_suspect = self._best_of([], found, runs, association)
        if best.score < _LEAST_SCORE:
            return None
        return self._finished(points_lidar_m, runs, best, is_suspect, association)

    @property
    def _target(self) -> Target:
        return Target(self.patch_map.narrow, self.patch_map.wide, self.patch_map.arrays)

    @property
    def _good_score(self) -> float:
        return self._usual_score - _SCORE_TOLERANCE

    def _prepared(self, points_lidar_m: Points) -> tuple[Runs, Association]:
        runs = cut_runs(in_order(points_lidar_m), self.patch_map.sigma_by_range_m)
        return runs, room_for(len(self.patch_map.arrays.planes), len(runs.num_points))

    def _follow(self, runs: Runs, T: Float, gate_m: float, association: Association) -> _Candidate:
        T = T.copy()
        return _Candidate(self._score(approach(runs, T, self._target, gate_m, 1, association)), T)

    def _best_of(
        self, followed: list[_Candidate], poses: list[Float], runs: Runs, association: Association
    ) -> tuple[_Candidate, bool]:
        """The best of candidates and of what the poses lead to, and whether another place is about as good."""
        for T in poses:
            followed = [*followed, self._follow(runs, T, _SEARCH_GATE_M, association)]
        if not followed:
            return _Candidate(0.0, np.eye(3, 4)), False
        best = max(followed, key=lambda candidate: candidate.score)
        rivals = [other.score for other in followed if not is_same_place(other.T, best.T, _SLIP_M)]
        return best, max(rivals, default=-1.0) > best.score - _RIVAL_MARGIN

    def _finished(
        self, points_m: Points, runs: Runs, best: _Candidate, is_suspect: bool, association: Association
    ) -> RegistrationResult:
        """The result at the best candidate, moved by all points; kept until it is accepted."""
        T = best.T.copy()
        counts, step = finish(runs, T, self._target, association)
        share = counts.num_explained / max(counts.num_points, 1)
        self._found = _Found(points_m, runs, association, T, self._score(counts), share)
        H = np.empty((6, 6))
        squares_m2, num = normal_sums(T, association, self.patch_map.arrays.planes, H)
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = T[:, :3]
        return RegistrationResult(
            T_map_lidar=SE3.projected(np.vstack([T, [0.0, 0.0, 0.0, 1.0]])),
            is_converged=step < 1e-4,
            num_iterations=1,
            num_points=len(points_m),
            num_inliers=num,
            fitness_m2=squares_m2 / num if num else None,
            score=min(max(self._found.score, 0.0), 1.0),
            hessian=turn @ H @ turn.T,
            is_suspect=is_suspect,
            sigma_m=float(np.median(runs.sigma_m)) if len(runs.sigma_m) else None,
        )

    def _score(self, counts: Counts) -> float:
        share = counts.num_explained / max(counts.num_points, 1)
        return _agreement(counts) - 2.0 * max(0.0, _SHARE_OF_USUAL * self._usual_share - share)

    def _learn(self, found: _Found) -> None:
        """What is usual, from a scan that was accepted; of its noise, in the 2nd, 4th, 8th ... scan."""
        self._usual_score += _FORGETTING * (found.score - self._usual_score)
        self._usual_share += _FORGETTING * (found.share - self._usual_share)
        n = self._num_scans
        self._num_scans += 1
        if self._config.range_noise_m is None and n <= _NOISE_SCANS and n & (n - 1) == 0:
            known = self.patch_map.sigma_by_range_m
            known[:] = np.sqrt((n * known**2 + sigma_by_range(in_order(found.points_m)) ** 2) / (n + 1))


def _agreement(counts: Counts) -> float:
    return counts.num_explained / max(counts.num_explained + counts.num_contradicted, 1)


def _rows(T: SE3) -> Float:
    """The pose as (3, 4)."""
    return np.ascontiguousarray(T.matrix[:3])
