"""The method `plane`: scans are aligned to patches of plane, which are tracked by their moments."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes import outlines
from services.mapper.planes.alignment import Counts, Target, approach, finish
from services.mapper.planes.association import Association, associate, room_for
from services.mapper.planes.gauss_newton import normal_sums
from services.mapper.planes.growth import first_map, take_in
from services.mapper.planes.noise import sigma_by_range
from services.mapper.planes.order import in_order
from services.mapper.planes.patches import Patches, PatchMap
from services.mapper.planes.runs import Runs, cut_runs
from services.mapper.planes.search import (
    Reach,
    candidates,
    candidates_anywhere,
    is_same_place,
    pieces_of,
    weakly_shifted,
)
from services.mapper.planes.snapshot import patch_map_of, table_state
from services.mapper.registration import Points, RegistrationResult, Surface
from services.mapper.state import PlanesState, TargetState
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

Float = NDArray[np.float64]

_GATE_M = 0.05
"""Half the width of the narrowest face: a wider first gate takes points to the other face of a bar, and stays there."""
_SEARCH_GATE_M = 0.1
_WIDER_GATES_M = (0.2, 0.1)
_TOLERANCE = 0.06
"""An agreement so far below the usual is looked into: right ones vary by less."""
_SUSPECT_TOLERANCE = 0.15
"""Farther below, the best place is not believed: slips along a bar had lost 0.2 and more."""
_SHARE_OF_USUAL = 0.75
"""A place that gains so much less than usual may be a look-alike: it is compared with others."""
_LEAST_SHARE_OF_USUAL = 0.5
"""A found place that gains less than this share of the usual is not believed: look-alikes alone in reach had 0.35."""
_LEAST_SHARE_WHEN_LOST = 0.7
"""The same when more than the usual way is searched, which holds more look-alikes."""
_RIVAL_SHARE = 0.85
"""Another place that gains nearly as much as the best one: look-alikes of right places had up to 0.8 of theirs."""
_NUM_RIVALS = 3
"""So many further poses, in the order of their rough ratings, are followed once one fits as usual."""
_FORGETTING = 0.2
_SLIP_M = 0.025
"""Two poses farther apart are two answers."""
_SEARCH_ANGLE_RAD = np.radians(80.0)
_SEARCH_RADIUS_M = 0.3
_MAX_POSES = 600
_NOISE_SCANS = 16


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A pose (3, 4), and the points that agree with the map there."""

    T: Float
    counts: Counts


@dataclass(slots=True, eq=False)
class _Found:
    """A scan that was aligned, until it is accepted or another comes."""

    points_m: Points
    runs: Runs
    association: Association
    T: Float
    counts: Counts


class PlaneMatcher:
    """Finds scans in a map of plane patches (`ScanMatcher`)."""

    def __init__(self, config: MapperConfig) -> None:
        self._config = config
        self._map: PatchMap | None = None
        self._found: _Found | None = None
        self._num_scans = 0
        self._usual_agreement = self._usual_gain = 0.0

    @property
    def patch_map(self) -> PatchMap:
        """The map itself, as whole-run refinement takes it."""
        assert self._map is not None, "start the matcher first"
        return self._map

    @property
    def patches(self) -> Patches:
        """The patches as they are now."""
        return self.patch_map.snapshot

    def surfaces(self) -> list[Surface]:
        """Patches that touch and lie in one plane are one surface, whose id is the lowest of theirs."""
        if self._map is None:
            return []
        return outlines.surfaces(self.patches)

    def start(self, points_lidar_m: Points, T_map_lidar: SE3) -> None:
        """Begins an empty map with this scan, which is where it is said to be.

        Raises:
            RegistrationError: the scan shows fewer than three patches of plane.
        """
        self._map, counts = first_map(points_lidar_m, _rows(T_map_lidar), self._config)
        self._found = None
        self._usual_gain = counts.gain
        self._usual_agreement = counts.agreement - 0.5 * _TOLERANCE
        self._num_scans = 1

    def snapshot(self) -> TargetState:
        """The map and what was learnt; of a scan that was aligned and not accepted, nothing."""
        patch_map, n = self.patch_map, self.patch_map.num_patches
        known = patch_map.arrays
        state = PlanesState(
            planes=known.planes[:n],
            origins_m=known.origins[:n],
            moments=known.moments[:n],
            num_points=known.num_points[:n],
            narrow=table_state(patch_map.narrow),
            wide=table_state(patch_map.wide),
            voxel_m=patch_map.voxel_m,
            sigma_by_range_m=patch_map.sigma_by_range_m,
            num_scans=self._num_scans,
            usual_agreement=self._usual_agreement,
            usual_gain=self._usual_gain,
        )
        return TargetState(planes=state)

    def restore(self, state: TargetState) -> None:
        """Goes on with a map.

        Raises:
            ValueError: it cannot be one of these settings.
        """
        if (known := state.planes) is None:
            raise ValueError("is no map of planes")
        self._map, self._found = patch_map_of(known, self._config.max_planes), None
        self._num_scans = known.num_scans
        self._usual_agreement, self._usual_gain = known.usual_agreement, known.usual_gain

    def align(self, points_lidar_m: Points, guesses: Sequence[SE3], widening: float) -> RegistrationResult:
        """The best place of a scan near the guesses of T_map_lidar, the most likely first; searches wider as needed."""
        runs, association = self._prepared(points_lidar_m)
        poses = [_rows(guess) for guess in guesses]
        best, is_suspect = self._nearby(runs, poses, association), False
        if not self._is_as_usual(best.counts):
            pieces = pieces_of(runs, self.patch_map.voxel_m)
            reach = Reach(_SEARCH_ANGLE_RAD * widening, _SEARCH_RADIUS_M * widening, _MAX_POSES)
            found = candidates(runs, pieces, poses, reach, self._target, self.patch_map.num_patches)
            least_share = _LEAST_SHARE_OF_USUAL if widening <= 1.0 else _LEAST_SHARE_WHEN_LOST
            best, is_suspect = self._best_of([best], found, runs, association, least_share)
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
        best, is_suspect = self._best_of([], found, runs, association, _LEAST_SHARE_WHEN_LOST)
        if best.counts.agreement < self._config.min_score:
            return None
        return self._finished(points_lidar_m, runs, best, is_suspect, association)

    @property
    def _target(self) -> Target:
        return Target(self.patch_map.narrow, self.patch_map.wide, self.patch_map.arrays)

    def _is_as_usual(self, counts: Counts) -> bool:
        return (
            counts.agreement >= self._usual_agreement - _TOLERANCE and counts.gain >= _SHARE_OF_USUAL * self._usual_gain
        )

    def _prepared(self, points_lidar_m: Points) -> tuple[Runs, Association]:
        runs = cut_runs(in_order(points_lidar_m), self.patch_map.sigma_by_range_m)
        return runs, room_for(len(self.patch_map.arrays.planes), len(runs.num_points))

    def _nearby(self, runs: Runs, guesses: list[Float], association: Association) -> _Candidate:
        """From the guesses alone, through gates ever wider, until the map explains as much of the scan as usual."""
        first = self._follow(runs, guesses[0], _GATE_M, association)
        if self._is_as_usual(first.counts):
            return first
        for gate_m, guess in itertools.product(_WIDER_GATES_M, guesses):
            candidate = self._follow(runs, guess, gate_m, association)
            if self._is_as_usual(candidate.counts):
                return candidate
        return first

    def _follow(self, runs: Runs, T: Float, gate_m: float, association: Association) -> _Candidate:
        T = T.copy()
        return _Candidate(T, approach(runs, T, self._target, gate_m, 1, association))

    def _best_of(
        self,
        followed: list[_Candidate],
        poses: Float,
        runs: Runs,
        association: Association,
        least_share: float,
    ) -> tuple[_Candidate, bool]:
        """The best of candidates and of what the poses lead to, and whether it may be wrong nevertheless."""
        num_left = len(poses)
        for T in poses:
            if num_left == 0:
                break
            num_left -= 1
            if not any(is_same_place(T, other.T, _SLIP_M) for other in followed):
                followed = [*followed, self._follow(runs, T, _SEARCH_GATE_M, association)]
                if self._is_as_usual(followed[-1].counts):
                    num_left = min(num_left, _NUM_RIVALS)
        if not followed:
            return _Candidate(np.eye(3, 4), Counts(0, 0, 0, 0)), True
        best = max(followed, key=_gain)
        if not self._is_as_usual(best.counts):
            shifted = weakly_shifted(best.T, self._normal_sums(best.T, runs, association)[0])
            followed = [*followed, *(self._follow(runs, T, _GATE_M, association) for T in shifted)]
            best = max(followed, key=_gain)
        rivals = [other.counts.gain for other in followed if not is_same_place(other.T, best.T, _SLIP_M)]
        is_rivalled = max(rivals, default=-1.0) > _RIVAL_SHARE * best.counts.gain
        is_poor = best.counts.agreement < self._usual_agreement - _SUSPECT_TOLERANCE
        return best, is_rivalled or is_poor or best.counts.gain < least_share * self._usual_gain

    def _normal_sums(self, T: Float, runs: Runs, association: Association) -> tuple[Float, float, int]:
        """The Hessian (6, 6) along the map's axes, the sum of squared distances in m^2, the number of inliers."""
        associate(runs, 1, T, self.patch_map.narrow, self.patch_map.arrays.planes, association)
        return self._sums_of(T, association)

    def _sums_of(self, T: Float, association: Association) -> tuple[Float, float, int]:
        H = np.empty((6, 6))
        squares_m2, num = normal_sums(T, association, self.patch_map.arrays.planes, H)
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = T[:, :3]
        return turn @ H @ turn.T, squares_m2, num

    def _finished(
        self, points_m: Points, runs: Runs, best: _Candidate, is_suspect: bool, association: Association
    ) -> RegistrationResult:
        """The result at the best candidate, moved by all points; kept until it is accepted."""
        T = best.T.copy()
        counts, step = finish(runs, T, self._target, association)
        self._found = _Found(points_m, runs, association, T, counts)
        hessian, squares_m2, num = self._sums_of(T, association)
        return RegistrationResult(
            T_map_lidar=SE3(T[:, :3], T[:, 3]),
            is_converged=step < 1e-4,
            num_iterations=best.counts.num_steps + counts.num_steps,
            num_points=len(points_m),
            num_inliers=num,
            fitness_m2=squares_m2 / num if num else None,
            score=counts.agreement,
            hessian=hessian,
            is_suspect=is_suspect,
            sigma_m=float(runs.sigma_m.mean()) if len(runs.sigma_m) else None,
        )

    def _learn(self, found: _Found) -> None:
        """What is usual, from a scan that was accepted; of its noise, in the 2nd, 4th, 8th ... scan."""
        self._usual_agreement += _FORGETTING * (found.counts.agreement - self._usual_agreement)
        self._usual_gain += _FORGETTING * (found.counts.gain - self._usual_gain)
        n = self._num_scans
        self._num_scans += 1
        if self._config.range_noise_m is None and n <= _NOISE_SCANS and n & (n - 1) == 0:
            known = self.patch_map.sigma_by_range_m
            known[:] = np.sqrt((n * known**2 + sigma_by_range(in_order(found.points_m)) ** 2) / (n + 1))


def _gain(candidate: _Candidate) -> float:
    return candidate.counts.gain


def _rows(T: SE3) -> Float:
    """The pose as (3, 4)."""
    return np.ascontiguousarray(T.matrix[:3])
