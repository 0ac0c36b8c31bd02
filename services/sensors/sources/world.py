"""The world of a real LiDAR, for viewers: nobody knows where the map lies in it, so the map is the world."""

from __future__ import annotations

import numpy as np

from shared.messaging.messages import Transforms

_WORLD, _MAP = "world", "map"
"""The frames of ARCHITECTURE.md. With a simulated LiDAR the evaluator joins them, which has the truth."""
_EARLIER_NS = 200_000_000
"""A scan is stamped at its first point and comes at its last: it may be older than what came first."""


def world_of_map(first_stamp_ns: int) -> Transforms:
    """World and map are one, from before the first message."""
    return Transforms(
        stamp_ns=max(0, first_stamp_ns - _EARLIER_NS),
        seq=0,
        frame=_WORLD,
        parents=(_WORLD,),
        children=(_MAP,),
        T_parent_child=np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]),
    )
