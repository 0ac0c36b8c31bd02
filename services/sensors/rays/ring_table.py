"""The beams of a LiDAR as the kernels take them: in groups of rings of nearly one azimuth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.sensors.lidar.beams import Beams

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

_MAX_GROUP_WIDTH_RAD = 2e-3
"""Rings whose azimuths differ by less are drawn together."""
_NUM_BINS = 1024


class RingTable(NamedTuple):
    """R rings in G groups: ring[i] is the number of the i-th, and place[ring[i]] is i.

    Those of group g go from start[g] to start[g + 1]. tangent (R,): of the elevations, falling within a group.
    direction (3, R): unit vectors outward, to the left and up, seen along the encoder. cos, sin (G,): of the groups'
    middle azimuths. spread (G,): tangent of the largest deviation from them. widest_rad: the largest azimuth. bins
    (G, n): the first ring at or below an elevation of tangent tangent_top[g] - i / bins_per_tangent[g].
    """

    ring: NDArray[np.int32]
    place: NDArray[np.uint32]
    start: NDArray[np.int32]
    tangent: Float
    direction: Float32
    cos: Float
    sin: Float
    spread: Float
    widest_rad: float
    top_rad: float
    bottom_rad: float
    bins: NDArray[np.int32]
    tangent_top: Float
    bins_per_tangent: Float


def ring_table(beams: Beams) -> RingTable:
    """The table of these beams.

    Raises:
        ValueError: elevations that do not fall from ring to ring, or are not between -90 and 90 degrees.
    """
    elevation, azimuth = beams.elevation_rad, beams.azimuth_rad
    if (np.diff(elevation) >= 0).any() or np.abs(elevation).max(initial=0.0) >= np.pi / 2:
        raise ValueError("elevation_rad must fall from ring to ring, between 90 and -90 degrees")
    group = _groups(azimuth)
    num_groups = int(group.max(initial=-1)) + 1
    ring = np.argsort(group, kind="stable")
    start = np.searchsorted(group[ring], np.arange(num_groups + 1))
    middle = np.array([(azimuth[group == g].min() + azimuth[group == g].max()) / 2 for g in range(num_groups)])
    tangent = np.tan(elevation[ring])
    tops = tangent[start[:-1]]
    per_tangent = (_NUM_BINS - 1) / np.maximum(tops - tangent[start[1:] - 1], 1e-9)
    edges = tops[:, np.newaxis] - np.arange(_NUM_BINS) / per_tangent[:, np.newaxis]
    bins = [a + np.searchsorted(-tangent[a:b], -edge) for a, b, edge in zip(start[:-1], start[1:], edges, strict=True)]
    flat, own = np.cos(elevation[ring]), azimuth[ring]
    return RingTable(
        ring=ring.astype(np.int32),
        place=np.argsort(ring).astype(np.uint32),
        start=start.astype(np.int32),
        tangent=tangent,
        direction=np.stack([flat * np.cos(own), flat * np.sin(own), np.sin(elevation[ring])]).astype(np.float32),
        cos=np.cos(middle),
        sin=np.sin(middle),
        spread=np.array([np.tan(np.abs(azimuth[group == g] - middle[g]).max()) for g in range(num_groups)]),
        widest_rad=float(np.abs(azimuth).max(initial=0.0)),
        top_rad=float(elevation.max(initial=-1.5)),
        bottom_rad=float(elevation.min(initial=1.5)),
        bins=np.array(bins, dtype=np.int32).reshape(num_groups, _NUM_BINS),
        tangent_top=tops,
        bins_per_tangent=per_tangent,
    )


def _groups(azimuth_rad: Float) -> NDArray[np.int64]:
    """Numbers of groups of azimuths that lie near each other."""
    group = np.zeros(len(azimuth_rad), dtype=np.int64)
    number, first = -1, -np.inf
    for i in np.argsort(azimuth_rad, kind="stable"):
        if azimuth_rad[i] - first > _MAX_GROUP_WIDTH_RAD:
            number, first = number + 1, azimuth_rad[i]
        group[i] = number
    return group
