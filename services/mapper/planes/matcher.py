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
from services.mapper.planes.patches import Patches, PatchMap
from services.mapper.planes.runs import Runs, cut_runs
from services.mapper.planes.search import Reach, candidates, is_same_place, pieces_of
from services.mapper.registration import Points, RegistrationResult
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

Float = NDArray[np.float64]

_GATE_M = 0.05
"""Half the width of the narrowest face: a wider first gate takes points to the other face of a bar, and stays there."""
_SCORE_TOLERANCE = 0.06
"""A score so far below the usual is looked into: right ones vary by less."""
_SHARE_OF_USUAL = 0.6
_FORGETTING = 0.2


_NUM_FOLLOWED = 10
_SLIP_M = 0.025
_RIVAL_MARGIN = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A pose (3, 4), and its score."""

    score: float
    T: Float


@dataclass(slots=True)
class _Found:
    """A scan that was aligned, until it is accepted or another comes."""

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
        self.stages = [0] * 6

    @property
    def patch_map(self) -> PatchMap:
        """The map itself, which changes with every accepted scan."""
        assert self._map is not None, "start the matcher first"
        return self._map

    @property
    def patches(self) -> Patches:
        """The patches as they are now."""
        assert self._map is not None, "start the matcher first"
        return self._map.snapshot

    def start(self, points_lidar_m: Points, T_map_lidar: SE3) -> None:
        """Begins an empty map with this scan, which is where it is said to be.

        Raises:
            RegistrationError: the scan shows fewer than three patches of plane.
        """
        self._map, counts = first_map(points_lidar_m, _pose_array(T_map_lidar), self._config)
        self._usual_share = counts.num_explained / max(counts.num_points, 1)
        self._usual_score = _explained_share(counts) - 0.5 * _SCORE_TOLERANCE
        self._num_scans = 1

    def align(self, points_lidar_m: Points, guesses: Sequence[SE3], widening: float) -> RegistrationResult:
        """The best place of a scan near the guesses of T_map_lidar, the most likely first; searches wider as needed."""
        assert self._map is not None, "start the matcher first"
        runs = cut_runs(points_lidar_m, self._map.sigma_by_range_m)
        association = room_for(self._config.max_planes, len(runs.num_points))
        target = self._target()
        poses = [_pose_array(guess) for guess in guesses]
        best = self._follow(runs, poses[0], _GATE_M, association)
        is_suspect = False
        if best.score < self._usual_score - _SCORE_TOLERANCE:
            best, is_suspect = self._searched(runs, poses, widening, best, association)
        T = best.T.copy()
        counts, step = finish(runs, T, target, association)
        self._found = _Found(runs, association, T, self._score(counts), counts.num_explained / max(counts.num_points, 1))
        return self._result(step, is_suspect)

    def _follow(self, runs: Runs, T: Float, gate_m: float, association: Association) -> _Candidate:
        T = T.copy()
        return _Candidate(self._score(approach(runs, T, self._target(), gate_m, 1, association)), T)

    def _searched(
        self, runs: Runs, guesses: list[Float], widening: float, first: _Candidate, association: Association
    ) -> tuple[_Candidate, bool]:
        """The best candidate near the guesses, and whether another place is about as good."""
        assert self._map is not None
        self.stages[1] += 1
        good = self._usual_score - _SCORE_TOLERANCE
        pieces = pieces_of(runs, self._map.voxel_m)
        reach = Reach(np.radians(80.0) * widening, 0.3 * widening, 600)
        found = candidates(runs, pieces, guesses, reach, self._target(), self._map.num_patches, _NUM_FOLLOWED)
        followed = [first]
        for T in found:
            followed.append(self._follow(runs, T, 2.0 * _GATE_M, association))
            if followed[-1].score > good:
                break
        best = max(followed, key=lambda candidate: candidate.score)
        rivals = [c.score for c in followed if not is_same_place(c.T, best.T, _SLIP_M)]
        return best, max(rivals, default=0.0) > best.score - _RIVAL_MARGIN

    def accept(self, T_map_lidar: SE3) -> None:
        """The scan aligned last was here: takes what it shows into the map."""
        assert self._map is not None and self._found is not None, "align a scan first"
        found, T = self._found, _pose_array(T_map_lidar)
        self._found = None
        patches = self._map.arrays.planes
        if not np.allclose(T, found.T, rtol=0.0, atol=1e-6):
            associate(found.runs, 1, T, self._map.narrow, patches, found.association)
        take_in(self._map, found.runs, T, found.association)
        self._usual_score += _FORGETTING * (found.score - self._usual_score)
        self._usual_share += _FORGETTING * (found.share - self._usual_share)
        self._num_scans += 1

    def localise(self, points_lidar_m: Points) -> RegistrationResult | None:
        """The best place of a scan anywhere in the map, from no guess; None where nothing fits."""
        return None

    def _target(self) -> Target:
        assert self._map is not None
        return Target(self._map.narrow, self._map.wide, self._map.arrays)

    def _score(self, counts: Counts) -> float:
        share = counts.num_explained / max(counts.num_points, 1)
        return _explained_share(counts) - 2.0 * max(0.0, _SHARE_OF_USUAL * self._usual_share - share)

    def _result(self, step: float, is_suspect: bool) -> RegistrationResult:
        assert self._found is not None and self._map is not None
        found, H = self._found, np.empty((6, 6))
        squares_m2, num = normal_sums(found.T, found.association, self._map.arrays.planes, H)
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = found.T[:, :3]
        num_points = int(found.runs.num_points.sum())
        return RegistrationResult(
            T_map_lidar=SE3.projected(np.vstack([found.T, [0.0, 0.0, 0.0, 1.0]])),
            is_converged=step < 1e-4,
            num_iterations=1,
            num_points=num_points,
            num_inliers=num,
            fitness_m2=squares_m2 / num if num else None,
            score=min(max(found.score, 0.0), 1.0),
            hessian=turn @ H @ turn.T,
            is_suspect=is_suspect,
            sigma_m=float(np.median(found.runs.sigma_m)) if num_points else None,
        )


def _explained_share(counts: Counts) -> float:
    return counts.num_explained / max(counts.num_explained + counts.num_contradicted, 1)


def _pose_array(T: SE3) -> Float:
    return np.ascontiguousarray(np.column_stack([T.rotation, T.translation]))
