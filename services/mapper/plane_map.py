"""The planes of the map as a message."""

from __future__ import annotations

import colorsys

import numpy as np
from numpy.typing import NDArray

from services.mapper.registration import ScanMatcher
from shared.messaging.messages import Plane, PlaneMap

_GOLDEN_RATIO = 0.618033988749895


def plane_map(matcher: ScanMatcher, stamp_ns: int, seq: int, frame: str) -> PlaneMap:
    """All surfaces that the matcher knows; none where it knows no planes."""
    planes = tuple(
        Plane(
            id=surface.id,
            coefficients=surface.plane,
            num_inliers=surface.num_points,
            outline_m=surface.outline_m.astype(np.float32),
            colour=colour_of(surface.id),
        )
        for surface in matcher.surfaces()
    )
    return PlaneMap(stamp_ns=stamp_ns, seq=seq, frame=frame, planes=planes)


def colour_of(plane_id: int) -> NDArray[np.float64]:
    """Red, green, blue (3,), 0..1: neighbouring ids are far apart in hue, and a plane keeps its colour."""
    return np.array(colorsys.hsv_to_rgb(plane_id * _GOLDEN_RATIO % 1.0, 0.65, 0.95))
