"""How near the map that the mapper publishes is to the structure, quickly enough to be told while it grows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.evaluator.map_accuracy import MapAccuracy, accuracy_of, distances_to_structure
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.messaging.messages import PointCloud, StructureDescription
from shared.robot.description import UrdfModel
from shared.robot.urdf import parse_urdf

_MAX_POINTS = 5000
"""The mean distance is then known to 1 % or so; against a hundred boxes it takes some 30 ms."""


class LiveMap:
    """The newest map and the structure it is of. seed: of the draw of points that are judged."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._structure: UrdfModel | None = None
        self._points_m: NDArray[np.floating] | None = None

    @property
    def num_points(self) -> int | None:
        """Of the newest map; None before there is one."""
        return None if self._points_m is None else len(self._points_m)

    def set_structure(self, description: StructureDescription) -> None:
        """Takes the structure's shapes.

        Raises:
            InputFileError: the URDF is malformed, or has more than one link.
        """
        model = parse_urdf(description.urdf, "structure_description")
        if len(model.links) > 1:
            raise InputFileError(f"structure_description: must be one link, is {', '.join(model.links)}")
        self._structure = model

    def set_cloud(self, cloud: PointCloud) -> None:
        """Takes the newest map."""
        self._points_m = cloud.points_m

    def forget(self) -> None:
        """There is no map yet: the mapper was started again."""
        self._points_m = None

    def accuracy(self, T_world_map: SE3) -> MapAccuracy | None:
        """Of at most 5,000 of the map's points; None without a map or a structure, or where either is empty."""
        if self._structure is None or self._points_m is None:
            return None
        points_m = self._points_m
        if len(points_m) == 0 or not self._structure.shapes:
            return None
        if len(points_m) > _MAX_POINTS:
            rng = np.random.default_rng(self._seed)
            points_m = points_m[rng.choice(len(points_m), _MAX_POINTS, replace=False, shuffle=False)]
        return accuracy_of(distances_to_structure(T_world_map.apply(points_m.astype(np.float64)), self._structure))
