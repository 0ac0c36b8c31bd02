"""ICP whose distances are those along the target's normals, so that points may slide on surfaces."""

from __future__ import annotations

from typing import Any

import small_gicp

from services.mapper.methods.iterative import IterativeRegistration
from shared.geometry import SE3


class PointToPlane(IterativeRegistration):
    """Source: Chen, Medioni, "Object modelling by registration of multiple range images", IVC 1992."""

    def _iterate(self, source: small_gicp.PointCloud, T_map_lidar: SE3, max_correspondence_m: float) -> Any:
        return self._align_to_points(source, T_map_lidar, max_correspondence_m, "PLANE_ICP")
