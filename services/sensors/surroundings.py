"""What a simulated sensor can see: the scene of the two descriptions, where its parts are, and when to look."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.sensors.other_robots import OtherRobots
from services.sensors.rays.interface import Poses
from services.sensors.scene import Scene, scene_of
from shared.errors import InputFileError, MessageError
from shared.messaging.frames import motion_of
from shared.messaging.messages import RobotDescription, StructureDescription, Transforms
from shared.robot.description import Shape
from shared.robot.urdf import parse_urdf

MEMBERS_A_ROBOT = 1_000_000
"""The ground truth numbers the visuals of the first other robot from here on, those of the second from twice this."""


class Surroundings:
    """The structure's shapes, then the robot's, then other robots', as one scene. None until the first two are known.

    frame: the sensor's, a link of the robot. sees_robot: whether the robot's shapes belong to the scene. sensor_name:
    for messages to people. other_robots: their names. on_scene: called with each new scene.
    """

    def __init__(
        self,
        frame: str,
        *,
        sees_robot: bool,
        sensor_name: str,
        other_robots: Sequence[str] = (),
        on_scene: Callable[[Scene], None] | None = None,
    ) -> None:
        self._frame = frame
        self._sees_robot = sees_robot
        self._sensor_name = sensor_name
        self._on_scene = on_scene
        self._robot: tuple[Shape, ...] | None = None
        self._structure: tuple[Shape, ...] | None = None
        self._others = OtherRobots(other_robots)
        self.scene: Scene | None = None

    @property
    def own_shapes(self) -> slice:
        """Which shapes of the scene are the robot's own."""
        start = len(self._structure or ())
        return slice(start, start + len(self._robot or ()))

    def set_robot(self, description: RobotDescription) -> None:
        """Takes the robot's visible shapes.

        Raises:
            InputFileError: the URDF is malformed, or has no link of the sensor's frame.
        """
        model = parse_urdf(description.urdf, "robot_description")
        if self._frame not in model.links:
            links = ", ".join(model.links)
            raise InputFileError(
                f"robot_description: no link '{self._frame}' for the {self._sensor_name}; links are {links}"
            )
        self._robot = model.shapes if self._sees_robot else ()
        self._set_scene()

    def set_structure(self, description: StructureDescription) -> None:
        """Takes the structure's shapes, all of one link, which stands where the description's frame is.

        Raises:
            InputFileError: the URDF is malformed, or has more than one link.
        """
        model = parse_urdf(description.urdf, "structure_description")
        if len(model.links) > 1:
            raise InputFileError(f"structure_description: must be one link, is {', '.join(model.links)}")
        self._structure = tuple(replace(shape, link=description.frame) for shape in model.shapes)
        self._set_scene()

    def set_other(self, name: str, description: RobotDescription) -> None:
        """Takes the visible shapes of another robot.

        Raises:
            InputFileError: the URDF is malformed.
        """
        self._others.set_robot(name, description)
        self._set_scene()

    def place_other(self, name: str, transforms: Transforms) -> None:
        """Takes where another robot is.

        Raises:
            MessageError: they do not begin at `world`, or leave out a link that can be seen.
        """
        if self._others.place(name, transforms):
            self._set_scene()

    def joined(self, transforms: Transforms) -> Transforms:
        """The robot's transforms, and with them where the other robots of the scene are."""
        return self._others.joined(transforms)

    def poses(self, transforms: Sequence[Transforms], stamps_ns: ArrayLike, num_blocks: int = 1) -> Poses:
        """Where the sensor is at each of N times and the scene's links are in the middle of each block of them.

        transforms: at least one, their stamps increase; what is between or outside is as in `shared.motion.Motion`.

        Raises:
            MessageError: the descriptions are not known yet, or the transforms do not connect the sensor with every
                link of the scene.
            ValueError: no transforms, or stamps that do not increase.
        """
        if self.scene is None:
            raise MessageError(f"the {self._sensor_name} needs the descriptions of robot and structure first")
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        motion = motion_of(transforms, [self._frame, *self.scene.links])
        sensor_rotation, sensor_translation_m = motion.of(slice(0, 1)).at(stamps)
        link_rotation, link_translation_m = motion.of(slice(1, None)).at(_block_middles(stamps, num_blocks))
        return Poses(
            sensor_rotation=sensor_rotation[:, 0],
            sensor_translation_m=sensor_translation_m[:, 0],
            link_rotation=link_rotation,
            link_translation_m=link_translation_m,
        )

    def _set_scene(self) -> None:
        if self._robot is None or self._structure is None:
            return
        others = self._others.shapes
        members = list(range(len(self._structure) + len(self._robot)))
        for number, shapes in enumerate(others, start=1):
            members += range(number * MEMBERS_A_ROBOT, number * MEMBERS_A_ROBOT + len(shapes))
        self.scene = scene_of((*self._structure, *self._robot, *itertools.chain(*others)), members)
        if self._on_scene is not None:
            self._on_scene(self.scene)


class Schedule:
    """Divides time into periods from zero on; the first stamp in each is due, so a late one delays no other."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._last_period: int | None = None

    def is_due(self, stamp_ns: int) -> bool:
        """Whether this stamp is in another period than the last: a later one, or an earlier one after a restart."""
        period = stamp_ns // self._period_ns
        is_due = period != self._last_period
        self._last_period = period
        return is_due


def _block_middles(stamps_ns: NDArray[np.int64], num_blocks: int) -> list[int]:
    """The middle of the first and the last time of each block; column c of C is in block c * num_blocks // C."""
    block = np.arange(len(stamps_ns)) * num_blocks // len(stamps_ns)
    return [int(stamps_ns[block == b][[0, -1]].sum() // 2) for b in range(num_blocks)]
