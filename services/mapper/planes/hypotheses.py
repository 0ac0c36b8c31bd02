"""Poses at which pieces of plane of a scan lie on patches of the map: rotations from pairs, translations from triples.

No guess is needed; one only leaves fewer of them. Nothing is assumed of how the planes lie.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from shared.kernel import kernel, lean_kernel

Float = NDArray[np.float64]

_SAME_DIRECTION = np.cos(np.radians(8.0))
"""Normals of small patches are a few degrees off; the faces of a lattice are tens of degrees apart."""
_MAX_SCAN_DIRECTIONS = 10
_MAX_MAP_DIRECTIONS = 24
_LEAST_WEIGHT = 0.01
"""Directions of a smaller share of the points are mostly not faces."""
_LEAST_SUPPORT = 0.7
_MAX_ROTATIONS = 48
_MAX_PARALLEL = np.cos(np.radians(30.0))
_NUM_PIECES = 8
_MIN_DETERMINANT = 0.4
"""Of three unit normals: flatter corners leave the translation loose."""
_SAME_OFFSET_M = 0.03
_MAX_OFFSETS = 16


@lean_kernel()
def _group(normals: Float, weights: Float, order: NDArray[np.int64], sums: Float, totals: Float) -> int:
    """Writes the groups' weighted sums (N, 3) and weights (N,); returns how many there are."""
    num = 0
    for k in order:
        best, best_cosine = -1, _SAME_DIRECTION
        for g in range(num):
            x, y, z = sums[g, 0], sums[g, 1], sums[g, 2]
            along = x * normals[k, 0] + y * normals[k, 1] + z * normals[k, 2]
            cosine = along / max(math.sqrt(x * x + y * y + z * z), 1e-300)
            if cosine > best_cosine:
                best, best_cosine = g, cosine
        if best < 0:
            best, num = num, num + 1
        totals[best] += weights[k]
        for axis in range(3):
            sums[best, axis] += weights[k] * normals[k, axis]
    return num


def distinct_directions(normals: Float, weights: Float, max_num: int) -> tuple[Float, Float]:
    """Unit vectors (D, 3) that stand for groups of normals (N, 3), with their weights (D,), the heaviest first."""
    sums, totals = np.zeros((len(normals), 3)), np.zeros(len(normals))
    num = _group(normals, weights, np.argsort(-weights, kind="stable"), sums, totals)
    order = np.argsort(-totals[:num], kind="stable")[:max_num]
    order = order[totals[order] > _LEAST_WEIGHT * totals.sum()]
    return sums[order] / np.linalg.norm(sums[order], axis=1, keepdims=True), totals[order]


def _triads(a: Float, b: Float) -> Float:
    """Right-handed orthonormal bases (N, 3, 3), as columns, from pairs of vectors that are not parallel (N, 3)."""
    z = np.cross(a, b)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x = a + b
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _pairs(directions: Float, is_ordered: bool) -> tuple[NDArray[np.int64], NDArray[np.int64], Float]:
    """Indices of pairs of directions that are neither parallel nor opposite, and their cosines."""
    i, j = np.indices((len(directions), len(directions))).reshape(2, -1)
    cosines = np.sum(directions[i] * directions[j], axis=1)
    is_usable = (np.abs(cosines) < _MAX_PARALLEL) & ((i < j) | ((i != j) & (not is_ordered)))
    return i[is_usable], j[is_usable], cosines[is_usable]


def rotations(scan_normals: Float, scan_weights: Float, map_normals: Float, map_weights: Float) -> Float:
    """Rotations R_map_lidar (H, 3, 3) that turn normals of the scan (N, 3) into normals of the map (M, 3) or their
    opposites, since a scan may show the backs of what is known. The first explain the most of the scan.
    """
    scan, weights = distinct_directions(scan_normals, scan_weights, _MAX_SCAN_DIRECTIONS)
    both, twice = np.concatenate([map_normals, -map_normals]), np.concatenate([map_weights, map_weights])
    known, _ = distinct_directions(both, twice, _MAX_MAP_DIRECTIONS)
    i, j, scan_cosines = _pairs(scan, is_ordered=True)
    a, b, map_cosines = _pairs(known, is_ordered=False)
    s, m = np.nonzero(np.abs(np.arccos(scan_cosines)[:, None] - np.arccos(map_cosines)) < np.radians(8.0))
    if not len(s):
        return np.empty((0, 3, 3))
    R = _triads(known[a[m]], known[b[m]]) @ _triads(scan[i[s]], scan[j[s]]).transpose(0, 2, 1)
    is_met = np.einsum("hij,sj,ki->hsk", R, scan, known).max(axis=2) > _SAME_DIRECTION
    support = is_met @ weights
    order = np.argsort(-support, kind="stable")
    R = R[order[support[order] > _LEAST_SUPPORT * support.max()]]
    kept: list[Float] = []
    while len(R) and len(kept) < _MAX_ROTATIONS:
        kept.append(R[0])
        R = R[angles_rad(R, R[0]) > np.arccos(_SAME_DIRECTION)]
    return _fitted(np.array(kept), scan, weights, known)


def _fitted(R: Float, scan: Float, weights: Float, known: Float) -> Float:
    """The rotations (H, 3, 3), each moved to fit all directions (D, 3) it turns into known ones (Kabsch 1976)."""
    cosines = np.einsum("hij,sj,ki->hsk", R, scan, known)
    nearest, w = known[cosines.argmax(axis=2)], weights * (cosines.max(axis=2) > _SAME_DIRECTION)
    U, _, Vt = np.linalg.svd(np.einsum("hs,hsi,sj->hij", w, nearest, scan))
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    fitted: Float = U @ Vt
    return fitted


def angles_rad(R: Float, of: Float) -> Float:
    """Angles (H,) between rotations (H, 3, 3) and one (3, 3)."""
    cosines = 0.5 * (np.einsum("hij,ij->h", R, of) - 1.0)
    angles: Float = np.arccos(np.clip(cosines, -1.0, 1.0))
    return angles


@kernel()
def _offsets(normal: Float, offset_m: float, planes: Float, near: Float, radius_m: float, out: Float) -> int:
    """How far a piece's plane in the lidar frame is moved along its normal by lying on parallel patches (M, 4).

    Only those that leave the lidar within `radius_m` of `near`; returns their number.
    """
    num = 0
    here = np.sum(normal * near)
    for j in range(len(planes)):
        if num == len(out):
            break
        if np.sum(planes[j, :3] * normal) < _SAME_DIRECTION:
            continue
        # A patch's offset is taken where the lidar is near, so that a tilt of its normal matters little.
        offset = offset_m - planes[j, 3] - np.sum((planes[j, :3] - normal) * near)
        is_new = abs(offset - here) < radius_m
        for k in range(num):
            is_new = is_new and abs(offset - out[k]) > _SAME_OFFSET_M
        if is_new:
            out[num] = offset
            num += 1
    return num


@lean_kernel()
def _determinant(a: Float, b: Float, c: Float) -> float:
    x, y, z = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]
    return float(a[0] * x + a[1] * y + a[2] * z)


@lean_kernel()
def _add_corner(n: Float, p: float, q: float, r: float, out: Float) -> None:
    """Writes the point (3,) where three planes n.x = (p, q, r) with normals n (3, 3) meet (Cramer's rule)."""
    determinant = _determinant(n[0], n[1], n[2])
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        out[k] = (
            p * (n[1, i] * n[2, j] - n[1, j] * n[2, i])
            + q * (n[2, i] * n[0, j] - n[2, j] * n[0, i])
            + r * (n[0, i] * n[1, j] - n[0, j] * n[1, i])
        ) / determinant


@lean_kernel()
def _add_corners(normals: Float, offsets: Float, num_offsets: NDArray[np.int64], out: Float, num: int) -> int:
    """Adds the points (N, 3) where three planes with normals (3, 3) meet, for each choice of their offsets."""
    for a in range(num_offsets[0]):
        for b in range(num_offsets[1]):
            for c in range(num_offsets[2]):
                if num < len(out):
                    _add_corner(normals, offsets[0, a], offsets[1, b], offsets[2, c], out[num])
                    num += 1
    return num


@kernel()
def _translations(normals: Float, offsets_m: Float, planes: Float, near: Float, radius_m: float, out: Float) -> int:
    """Writes translations (H, 3) that put three of the pieces (N, 3), (N,) on patches (M, 4); returns their number."""
    num_pieces, num = len(normals), 0
    offsets, num_offsets = np.empty((num_pieces, _MAX_OFFSETS)), np.zeros(num_pieces, np.int64)
    chosen = np.empty(3, np.int64)
    for i in range(num_pieces):
        num_offsets[i] = _offsets(normals[i], offsets_m[i], planes, near, radius_m, offsets[i])
    for i in range(num_pieces):
        for j in range(i):
            for k in range(j):
                if abs(_determinant(normals[i], normals[j], normals[k])) > _MIN_DETERMINANT:
                    chosen[0], chosen[1], chosen[2] = i, j, k
                    num = _add_corners(normals[chosen], offsets[chosen], num_offsets[chosen], out, num)
    return num


def translations(R: Float, pieces: Float, planes: Float, near_m: Float, radius_m: float, max_num: int) -> Float:
    """Translations (H, 3) of the lidar at which three pieces (N, 4), the largest first, lie on patches (M, 4).

    R (3, 3): of the lidar. Within about `radius_m` of `near_m` (3,), which comes first.
    """
    out = np.empty((max_num, 3))
    out[0] = near_m
    largest = pieces[:_NUM_PIECES]
    num = _translations(largest[:, :3] @ R.T, largest[:, 3].copy(), planes, near_m.copy(), radius_m, out[1:])
    found = out[: num + 1]
    found = found[np.linalg.norm(found - near_m, axis=1) <= 1.75 * radius_m]
    _, first = np.unique(np.round((found - near_m) / _SAME_OFFSET_M), axis=0, return_index=True)
    kept: Float = found[np.sort(first)]
    return kept
