"""Closes loops after a run: finds where it came back to, registers these places, and bends the trajectory to fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from services.mapper.methods.gicp import Gicp
from services.mapper.point_matcher import PointMatcher
from services.mapper.pose_graph import Edge, optimised
from services.mapper.registration import Points, RegistrationError
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

_MIN_PATH_M = 3.0
"""A place is come back to after a way of so much at least."""
_MAX_DISTANCE_M = 1.0
_NUM_NEIGHBOURS = 2
"""A return is registered to the cloud of that place and to so many before and after it."""
_STEP_SIGMA_M, _STEP_SIGMA_RAD = 0.01, 0.005
"""Of one step of odometry; only its ratio to that of a return matters."""
_RETURN_SIGMA_M, _RETURN_SIGMA_RAD = 0.005, 0.002
_MIN_WEIGHT = 0.5
"""A return with less weight at the end contradicted the others."""


@dataclass(frozen=True, slots=True)
class Return:
    """The run was at keyframe `earlier` again when it took keyframe `later`; T_earlier_later by registration."""

    earlier: int
    later: int
    T_earlier_later: SE3
    score: float


@dataclass(frozen=True, slots=True)
class ClosedLoops:
    """T_map_lidar: of every keyframe, the first one as it was. returns: those that were believed to the end."""

    T_map_lidar: list[SE3]
    returns: list[Return]


def close_loops(clouds_lidar_m: Sequence[Points], T_map_lidar: Sequence[SE3], config: MapperConfig) -> ClosedLoops:
    """Corrects the poses of keyframes by the places that were visited again; without any, they stay.

    clouds_lidar_m: the filtered points (N, 3) of each keyframe, in the lidar frame.
    """
    found = [found for pair in _pairs(T_map_lidar) if (found := _register(*pair, clouds_lidar_m, T_map_lidar, config))]
    if not found:
        return ClosedLoops(list(T_map_lidar), [])
    steps = [
        Edge(k, k + 1, a.inv() @ b, _STEP_SIGMA_M, _STEP_SIGMA_RAD, is_sure=True)
        for k, (a, b) in enumerate(pairwise(T_map_lidar))
    ]
    returns = [
        Edge(r.earlier, r.later, r.T_earlier_later, _RETURN_SIGMA_M, _RETURN_SIGMA_RAD, is_sure=False) for r in found
    ]
    graph = optimised(T_map_lidar, [*steps, *returns])
    weights = graph.weights[len(steps) :]
    return ClosedLoops(graph.T_map_pose, [r for r, weight in zip(found, weights, strict=True) if weight > _MIN_WEIGHT])


def _pairs(T_map_lidar: Sequence[SE3]) -> Iterator[tuple[int, int]]:
    """Each keyframe with the nearest one that is far back along the path, if it is near in space."""
    places_m = np.array([T.translation for T in T_map_lidar]).reshape(-1, 3)
    path_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places_m, axis=0), axis=1))])
    for later in range(len(places_m)):
        num_earlier = int(np.searchsorted(path_m, path_m[later] - _MIN_PATH_M, side="right"))
        distances_m = np.linalg.norm(places_m[:num_earlier] - places_m[later], axis=1)
        if num_earlier and distances_m.min() <= _MAX_DISTANCE_M:
            yield int(distances_m.argmin()), later


def _register(
    earlier: int, later: int, clouds_lidar_m: Sequence[Points], T_map_lidar: Sequence[SE3], config: MapperConfig
) -> Return | None:
    """The return if the later cloud fits to the place; None if it does not, or there is too little of it."""
    matcher = PointMatcher(config, Gicp)
    try:
        matcher.start(_place(earlier, clouds_lidar_m, T_map_lidar), SE3.identity())
    except RegistrationError:
        return None
    result = matcher.align(clouds_lidar_m[later], [T_map_lidar[earlier].inv() @ T_map_lidar[later]], widening=1.0)
    is_found = result.score >= config.min_score and not result.is_suspect
    return Return(earlier, later, result.T_map_lidar, result.score) if is_found else None


def _place(k: int, clouds_lidar_m: Sequence[Points], T_map_lidar: Sequence[SE3]) -> NDArray[np.floating]:
    """The clouds about keyframe k, in its frame."""
    T_k_map = T_map_lidar[k].inv()
    near = range(max(0, k - _NUM_NEIGHBOURS), min(len(clouds_lidar_m), k + _NUM_NEIGHBOURS + 1))
    return np.concatenate([(T_k_map @ T_map_lidar[i]).apply(clouds_lidar_m[i]) for i in near])
