"""Generalised ICP, plane to plane: distances weighted by the local shape of both clouds."""

from __future__ import annotations

from typing import Any

import small_gicp

from services.mapper.methods.iterative import IterativeRegistration
from shared.geometry import SE3


class Gicp(IterativeRegistration):
    """Source: Segal, Haehnel, Thrun, "Generalized-ICP", RSS 2009."""

    def _iterate(self, source: small_gicp.PointCloud, T_map_lidar: SE3, max_correspondence_m: float) -> Any:
        self._estimate_shapes(source)
        return self._align_to_points(source, T_map_lidar, max_correspondence_m, "GICP")
