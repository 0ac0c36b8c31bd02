"""Whole-run refinement: all poses and all patches together, from the moments of each scan on each patch.

Scans are condensed to ten numbers a (scan, patch): a block. Then Gauss-Newton over poses and patches, where the poses
are eliminated (6 x 6 each) and the patches, which are fewer, are solved for densely (bundle adjustment of planes).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.association import associate, room_for
from services.mapper.planes.bundle import Blocks, Equations, eliminate_poses, empty_equations, linearise, substitute
from services.mapper.planes.gauss_newton import factorise, solve_factorised
from services.mapper.planes.growth import map_of_scans
from services.mapper.planes.order import in_order
from services.mapper.planes.patches import PatchMap
from services.mapper.planes.runs import cut_runs
from services.mapper.registration import Points
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

Float = NDArray[np.float64]
Int = NDArray[np.int64]

_MAX_PATCHES = 1000
"""Only so many, those seen most often, take part: the dense solution costs the cube of their number."""
_MIN_POINTS = 6
_MAX_STEPS = 8
_LAST_STEP = 5e-6
_MAX_PASSES = 3
_NOISY_M = 0.015
_BASIN = 0.05
"""In metres, and in parts of a rotation's matrix: a pose that would move farther was not near, and stays as it was."""
_SETTLED_M = 1e-3
"""A pass that moved no pose farther leaves the runs on their patches."""


class Refined(NamedTuple):
    """T_map_lidar of each scan; the patches' planes (P, 4) in the map frame; how far they moved the poses (N,) in m."""

    poses: list[SE3]
    planes: Float
    moved_m: Float


def refine(scans: Iterable[Points], poses: Sequence[SE3], patch_map: PatchMap) -> Refined:
    """Poses of all scans (N, 3) at once, from those they were found at; the first pose and the map's frame stay.

    scans: in the order of the poses; read up to three times if it can be, as a list can. The basin is about 10 mm.
    """
    start = np.array([T.matrix[:3] for T in poses])
    T, planes = start.copy(), patch_map.arrays.planes[: patch_map.num_patches].copy()
    is_read_once = iter(scans) is scans
    for _ in range(1 if is_read_once else _MAX_PASSES):
        before = T.copy()
        _solve(condensed(scans, T, planes, patch_map), T, planes, patch_map.arrays.origins)
        is_lost = np.abs(T - start).max(axis=(1, 2)) > _BASIN
        T[is_lost] = start[is_lost]
        if np.abs(T - before).max() < _SETTLED_M:
            break
    refined = [SE3.projected(np.vstack([rows, [0.0, 0.0, 0.0, 1.0]])) for rows in T]
    return Refined(refined, planes, np.linalg.norm(T[:, :, 3] - start[:, :, 3], axis=1))


def refine_run(scans: Sequence[Points], poses: Sequence[SE3], patch_map: PatchMap, config: MapperConfig) -> Refined:
    """As `refine`; where ranges are noisy, once more in a map made anew at the refined poses, which is sharper."""
    first = refine(scans, poses, patch_map)
    if float(np.median(patch_map.sigma_by_range_m)) < _NOISY_M:
        return first
    anew = map_of_scans(scans, [T.matrix[:3] for T in first.poses], config)
    second = refine(scans, first.poses, anew)
    moves_m = [float(np.linalg.norm(a.translation - b.translation)) for a, b in zip(second.poses, poses, strict=True)]
    return Refined(second.poses, second.planes, np.array(moves_m))


def condensed(scans: Iterable[Points], T: Float, planes: Float, patch_map: PatchMap) -> Blocks:
    """What scans at poses T (N, 3, 4) say of planes (P, 4), as blocks in the order of the scans."""
    scan_of, patch_of, moments, num_points = [], [], [], []
    found = room_for(len(planes), 0)
    for i, points_m in enumerate(scans):
        runs = cut_runs(in_order(points_m), patch_map.sigma_by_range_m)
        found = found._replace(assigned=np.empty(len(runs.num_points), np.int32))
        associate(runs, 1, T[i], patch_map.narrow, planes, found)
        touched = np.sort(found.touched[: found.num_touched[0]])
        touched = touched[found.num_points[touched] >= _MIN_POINTS]
        scan_of.append(np.full(len(touched), i))
        patch_of.append(touched)
        moments.append(found.moments[touched])
        num_points.append(found.num_points[touched])
    blocks = Blocks(*(np.concatenate(values) for values in (scan_of, patch_of, moments, num_points)))
    return _worth_solving(blocks, len(planes))


def _worth_solving(blocks: Blocks, num_patches: int) -> Blocks:
    """Only patches that several scans saw: others say nothing of the poses."""
    num_scans = np.bincount(blocks.patches, minlength=num_patches)
    is_chosen = num_scans > 1
    is_chosen[np.argsort(-num_scans, kind="stable")[_MAX_PATCHES:]] = False
    keep = is_chosen[blocks.patches]
    return Blocks(blocks.scans[keep], blocks.patches[keep], blocks.moments[keep], blocks.num_points[keep])


def _solve(blocks: Blocks, T: Float, planes: Float, origins: Float) -> None:
    """Moves poses T (N, 3, 4) and planes (P, 4) to where the blocks are explained best."""
    chosen, rows = np.unique(blocks.patches, return_inverse=True)
    if not len(chosen):
        return
    blocks = blocks._replace(patches=rows.astype(np.int64))
    free, free_origins = planes[chosen], origins[chosen]
    equations: Equations = empty_equations(len(T), len(chosen), len(rows))
    starts = np.searchsorted(blocks.scans, np.arange(len(T) + 1))
    for _ in range(_MAX_STEPS):
        linearise(blocks, T, free, free_origins, equations)
        eliminate_poses(blocks, starts, equations)
        steps = -equations.reduced_gradient
        factorise(equations.reduced)
        solve_factorised(equations.reduced, steps)
        if substitute(blocks, starts, equations, steps, T, free, free_origins) < _LAST_STEP:
            break
    planes[chosen] = free
