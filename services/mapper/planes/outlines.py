"""Surfaces for display: patches that lie in one plane and touch are one, with a convex outline.

A patch counts as the rectangle that has its moments: of even density, half as long as sqrt(3) standard deviations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.patches import Patches
from services.mapper.registration import Surface

Float = NDArray[np.float64]

_SAME_COSINE = np.cos(np.radians(4.0))
_SAME_OFFSET_M = 0.02
_TOUCHING_M = 0.15
"""Between patches of one face there may be an edge's width that is left out on either side."""


def surfaces(patches: Patches) -> list[Surface]:
    """The patches that have points as surfaces, by id: the lowest of their patches', kept while that patch lives."""
    axes, halves_m = _rectangles(patches)
    groups = _touching(patches, axes, halves_m)
    return [
        _surface(patches, np.flatnonzero(groups == first), axes, halves_m) for first in np.unique(groups[groups >= 0])
    ]


def _rectangles(patches: Patches) -> tuple[Float, Float]:
    """The sides' directions (P, 2, 3), each of length 1, and half their lengths (P, 2)."""
    M = patches.moments / np.maximum(patches.moments[:, 9:], 1e-300)
    full = M[:, [0, 1, 2, 1, 4, 5, 2, 5, 7]].reshape(-1, 3, 3)
    mean = M[:, [3, 6, 8]]
    variances, vectors = np.linalg.eigh(full - mean[:, :, None] * mean[:, None, :])
    halves_m = np.sqrt(3.0 * np.maximum(variances[:, 1:], 0.0))
    return vectors[:, :, 1:].transpose(0, 2, 1), halves_m


def _touching(patches: Patches, axes: Float, halves_m: Float) -> NDArray[np.int64]:
    """For each patch (P,) the lowest of the patches that it is joined with; -1 without points."""
    groups = np.full(len(patches.ids), -1)
    for first in np.flatnonzero(patches.num_points > 0):
        if groups[first] >= 0:
            continue
        groups[first], queue = first, [int(first)]
        while queue:
            near = _neighbours(patches, axes, halves_m, queue.pop())
            new = near[(groups[near] < 0) & (patches.num_points[near] > 0)]
            groups[new] = first
            queue += new.tolist()
    return groups


def _neighbours(patches: Patches, axes: Float, halves_m: Float, k: int) -> NDArray[np.int64]:
    away = patches.centres_m - patches.centres_m[k]
    distances_m = np.linalg.norm(away, axis=1)
    towards = away / np.maximum(distances_m, 1e-9)[:, None]
    reach_m = np.sum(np.abs(np.einsum("pax,px->pa", axes, towards)) * halves_m, axis=1)
    own_reach_m = np.abs(towards @ axes[k].T) @ halves_m[k]
    is_level = np.abs(away @ patches.planes[k, :3]) < _SAME_OFFSET_M
    is_level &= np.abs(np.sum(away * patches.planes[:, :3], axis=1)) < _SAME_OFFSET_M
    is_parallel = patches.planes[:, :3] @ patches.planes[k, :3] > _SAME_COSINE
    return np.flatnonzero(is_parallel & is_level & (distances_m < reach_m + own_reach_m + _TOUCHING_M))


def _surface(patches: Patches, members: NDArray[np.int64], axes: Float, halves_m: Float) -> Surface:
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    sides = axes[members] * halves_m[members][:, :, None]
    corners_m = patches.centres_m[members][:, None] + np.einsum("cs,psx->pcx", signs, sides)
    weights = patches.num_points[members].astype(np.float64)
    normal = weights @ patches.planes[members, :3]
    normal /= np.linalg.norm(normal)
    centre_m = weights @ patches.centres_m[members] / weights.sum()
    return Surface(
        id=int(patches.ids[members[0]]),
        patch_ids=patches.ids[members],
        plane=np.append(normal, -normal @ centre_m),
        num_points=int(weights.sum()),
        outline_m=convex_outline(corners_m.reshape(-1, 3), normal, centre_m),
    )


def convex_outline(points_m: Float, normal: Float, centre_m: Float) -> Float:
    """The corners (C, 3) of the convex hull of points (N, 3), put onto the plane through the centre.

    Counter-clockwise where the normal (3,) points to the viewer. Source: Andrew 1979, the monotone chain.
    """
    x = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    x /= np.linalg.norm(x)
    basis = np.stack([x, np.cross(normal, x)])
    flat = np.unique(np.round((points_m - centre_m) @ basis.T, 9), axis=0)
    corners = np.array(_chain(flat)[:-1] + _chain(flat[::-1])[:-1])
    outline_m: Float = centre_m + corners @ basis
    return outline_m


def _chain(points: Float) -> list[Float]:
    """The lower half of the hull of points (N, 2) that are sorted; the upper one if they are sorted downwards."""
    chain: list[Float] = []
    for p in points:
        while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0.0:
            chain.pop()
        chain.append(p)
    return chain


def _turn(a: Float, b: Float, c: Float) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
