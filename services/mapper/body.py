"""Which points of a scan lie on the robot itself: each of its shapes is taken as a box with a margin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from services.mapper.registration import Points
from shared.geometry import SE3
from shared.kernel import lean_kernel
from shared.robot.description import Shape
from shared.solids import Box, Cylinder, Mesh, Solid, Sphere

Float = NDArray[np.float64]

_MARGIN_M = 0.03
"""Three standard deviations and more of a LiDAR's range noise."""


class BodyFilter:
    """The robot's shapes as boxes, each grown by `margin_m` to all sides and fixed to its link.

    links: names of the links that have shapes, in the order in which their poses are expected.
    """

    def __init__(self, shapes: Sequence[Shape], margin_m: float = _MARGIN_M) -> None:
        self.links = tuple(dict.fromkeys(shape.link for shape in shapes))
        self._link_of_box = np.array([self.links.index(shape.link) for shape in shapes], dtype=np.int64)
        boxes = [_box_of(shape.solid) for shape in shapes]
        self._T_link_box = np.array(
            [
                (shape.T_link_shape @ SE3(np.eye(3), centre_m)).matrix
                for shape, (centre_m, _) in zip(shapes, boxes, strict=True)
            ]
        ).reshape(-1, 4, 4)
        self._half_m = np.array([half_m for _, half_m in boxes]).reshape(-1, 3) + margin_m

    def on_body(self, points_sensor_m: Points, T_sensor_link: Float) -> NDArray[np.bool_]:
        """Whether each point (N, 3) lies in or on the robot (N,); no point that is not finite does.

        T_sensor_link (L, 4, 4): where the `links` were when the points were measured.

        Raises:
            ValueError: not one pose for each of the links.
        """
        if T_sensor_link.shape != (len(self.links), 4, 4):
            raise ValueError(f"the body needs poses ({len(self.links)}, 4, 4), got {T_sensor_link.shape}")
        T_sensor_box = T_sensor_link[self._link_of_box] @ self._T_link_box
        reaches_m = np.linalg.norm(T_sensor_box[:, :3, 3], axis=1) + np.linalg.norm(self._half_m, axis=1)
        is_body = np.zeros(len(points_sensor_m), dtype=np.bool_)
        _mark(
            np.ascontiguousarray(points_sensor_m),
            np.ascontiguousarray(T_sensor_box),
            self._half_m,
            float(reaches_m.max(initial=0.0)) ** 2,
            is_body,
        )
        return is_body


def _box_of(solid: Solid) -> tuple[Float, Float]:
    """The box around a solid, along its frame's axes: centre (3,) and half edge lengths (3,) in metres."""
    match solid:
        case Box(size_m):
            return np.zeros(3), np.array(size_m) / 2.0
        case Cylinder(radius_m, length_m):
            return np.zeros(3), np.array([radius_m, radius_m, length_m / 2.0])
        case Sphere(radius_m):
            return np.zeros(3), np.full(3, radius_m)
        case Mesh(vertices_m):
            low_m, high_m = vertices_m.min(axis=0).astype(np.float64), vertices_m.max(axis=0).astype(np.float64)
            return (low_m + high_m) / 2.0, (high_m - low_m) / 2.0


@lean_kernel()
def _mark(
    points: Points, T_sensor_box: Float, half_m: Float, reach_square_m2: float, is_body: NDArray[np.bool_]
) -> None:
    """Fills in which points are in a box; those out of the robot's reach are in none."""
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if x * x + y * y + z * z <= reach_square_m2:
            for box in range(len(half_m)):
                if _is_in_box(x, y, z, T_sensor_box[box], half_m[box]):
                    is_body[i] = True
                    break


@lean_kernel()
def _is_in_box(x: float, y: float, z: float, T_sensor_box: Float, half_m: Float) -> bool:
    x, y, z = x - T_sensor_box[0, 3], y - T_sensor_box[1, 3], z - T_sensor_box[2, 3]
    for axis in range(3):
        along_m = x * T_sensor_box[0, axis] + y * T_sensor_box[1, axis] + z * T_sensor_box[2, axis]
        if abs(along_m) > half_m[axis]:
            return False
    return True
