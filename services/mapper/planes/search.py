"""Where a scan may be when the prediction does not lead there: many poses are rated roughly, the best ones followed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.alignment import Target
from services.mapper.planes.association import seek_wide
from services.mapper.planes.extraction import extract_planes
from services.mapper.planes.hypotheses import angles_rad, rotations, translations
from services.mapper.planes.runs import Runs
from shared.kernel import lean_kernel

Float = NDArray[np.float64]

_ROUGH_GATE_M = 0.1
_NUM_ROUGH_RUNS = 120
_MAX_PIECES = 60
_MAX_CANDIDATES = 12
_NUM_WEAK = 2
_SHIFTS_M = (-0.12, -0.08, -0.04, 0.04, 0.08, 0.12)
"""Lengths of the slips that were met: within half a bar's width."""
_MAX_POSES_ANYWHERE = 2000
_APART_M = 0.06
_APART_COSINE = np.cos(0.06)


class Reach(NamedTuple):
    """How far from a guess is searched. max_poses: of each rotation."""

    angle_rad: float
    radius_m: float
    max_poses: int


class Pieces(NamedTuple):
    """Pieces of plane of one scan, the largest first: planes (P, 4) in the lidar frame, num_points (P,)."""

    planes: Float
    num_points: Float


def pieces_of(runs: Runs, voxel_m: float) -> Pieces:
    """The pieces of plane in a scan alone."""
    here = np.eye(3, 4)
    planes, labels = extract_planes(runs, np.arange(len(runs.num_points)), here, voxel_m, _MAX_PIECES)
    num_points = np.bincount(labels[labels >= 0], runs.num_points[labels >= 0], minlength=len(planes)).astype(float)
    order = np.argsort(-num_points, kind="stable")
    return Pieces(planes[order], num_points[order])


@lean_kernel()
def _rate(runs: Runs, stride: int, poses: Float, target: Target, out: Float) -> None:
    for h in range(len(poses)):
        rating, num = 0.0, 0
        for i in range(0, len(runs.centroids_m), stride):
            j, distance_m = seek_wide(runs, i, poses[h], target.wide, target.patches.planes, _ROUGH_GATE_M)
            num += 1
            if j >= 0:
                rating += 1.0 - (distance_m / _ROUGH_GATE_M) ** 2
        out[h] = rating / max(num, 1)


def ratings(runs: Runs, poses: Float, target: Target) -> Float:
    """Roughly how much of a scan the map explains at poses (H, 3, 4): 0..1, from about a hundred runs."""
    out = np.empty(len(poses))
    _rate(runs, max(1, len(runs.num_points) // _NUM_ROUGH_RUNS), poses, target, out)
    return out


def candidates(
    runs: Runs, pieces: Pieces, guesses: list[Float], reach: Reach, target: Target, num_patches: int
) -> Float:
    """Poses (H, 3, 4) near guesses (3, 4) that fit roughly, the best first, each well apart from the ones before."""
    known, turns = _known_planes(target, num_patches), _rotations(pieces, target, num_patches)
    poses = [np.stack(guesses)]
    for guess in guesses:
        is_near = angles_rad(turns, guess[:, :3]) <= reach.angle_rad
        for R in [guess[:, :3], *turns[is_near]]:
            poses.append(_poses(R, pieces, known, guess[:, 3], reach))
    return _best(runs, np.concatenate(poses), target)


def candidates_anywhere(runs: Runs, pieces: Pieces, target: Target, num_patches: int) -> Float:
    """Poses (H, 3, 4) anywhere in the map that fit roughly, the best first, each well apart from the ones before."""
    known, turns = _known_planes(target, num_patches), _rotations(pieces, target, num_patches)
    middle_m, reach = target.patches.origins[:num_patches].mean(axis=0), Reach(np.pi, np.inf, _MAX_POSES_ANYWHERE)
    poses = [_poses(R, pieces, known, middle_m, reach) for R in turns]
    return _best(runs, np.concatenate(poses), target) if poses else np.empty((0, 3, 4))


def _known_planes(target: Target, num_patches: int) -> Float:
    return target.patches.planes[:num_patches]


def _rotations(pieces: Pieces, target: Target, num_patches: int) -> Float:
    if not len(pieces.planes):
        return np.empty((0, 3, 3))
    weights = target.patches.num_points[:num_patches].astype(np.float64) + 1.0
    return rotations(pieces.planes[:, :3], pieces.num_points, _known_planes(target, num_patches)[:, :3], weights)


def _best(runs: Runs, poses: Float, target: Target) -> Float:
    return well_apart(poses[np.argsort(-ratings(runs, poses, target), kind="stable")], _MAX_CANDIDATES)


def _poses(R: Float, pieces: Pieces, planes: Float, near_m: Float, reach: Reach) -> Float:
    t = translations(R, pieces.planes, planes, near_m, reach.radius_m, reach.max_poses)
    poses = np.empty((len(t), 3, 4))
    poses[:, :, :3], poses[:, :, 3] = R, t
    return poses


def weakly_shifted(T: Float, hessian: Float) -> list[Float]:
    """The pose (3, 4), moved by a slip's length along the two directions that say least. hessian: in the map's axes."""
    _, directions = np.linalg.eigh(hessian[:3, :3])
    shifted = []
    for direction in directions.T[:_NUM_WEAK]:
        for shift_m in _SHIFTS_M:
            moved = T.copy()
            moved[:, 3] += shift_m * direction
            shifted.append(moved)
    return shifted


@lean_kernel()
def is_same_place(a: Float, b: Float, apart_m: float) -> bool:
    """Whether two poses (3, 4) are near to one another."""
    x, y, z = a[0, 3] - b[0, 3], a[1, 3] - b[1, 3], a[2, 3] - b[2, 3]
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += a[i, j] * b[i, j]
    return bool(x * x + y * y + z * z < apart_m * apart_m and 0.5 * (trace - 1.0) > _APART_COSINE)


@lean_kernel()
def _well_apart(poses: Float, kept: NDArray[np.int64]) -> int:
    num = 0
    for h in range(len(poses)):
        is_new = num < len(kept)
        for k in range(num):
            is_new = is_new and not is_same_place(poses[h], poses[kept[k]], _APART_M)
        if is_new:
            kept[num] = h
            num += 1
    return num


def well_apart(poses: Float, max_num: int) -> Float:
    """The first of poses (H, 3, 4) that are not near an earlier one."""
    kept = np.empty(max_num, np.int64)
    return poses[kept[: _well_apart(poses, kept)]]
