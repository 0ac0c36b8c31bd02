"""ICP: the squared distances between each point and the target point nearest to it."""

from __future__ import annotations

from typing import Any

import small_gicp

from services.mapper.methods.iterative import IterativeRegistration
from shared.geometry import SE3


class PointToPoint(IterativeRegistration):
    """Source: Besl, McKay, "A method for registration of 3-D shapes", PAMI 1992."""

    def _iterate(self, source: small_gicp.PointCloud, T_map_lidar: SE3, max_correspondence_m: float) -> Any:
        return self._align_to_points(source, T_map_lidar, max_correspondence_m, "ICP")
