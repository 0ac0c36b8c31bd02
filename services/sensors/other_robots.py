"""The other robots of the same world: what of them can be seen, and where they were when they last said so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from shared.errors import MessageError
from shared.messaging.frames import FrameTree
from shared.messaging.messages import RobotDescription, Transforms
from shared.robot.description import Shape
from shared.robot.urdf import parse_urdf

_WORLD = "world"


@dataclass(frozen=True, slots=True, eq=False)
class _Robot:
    """Edges are named as in the joint tree of all robots: `robot_b/hip` for the link `hip` of robot_b."""

    shapes: tuple[Shape, ...] = ()
    transforms: Transforms | None = None
    parents: tuple[str, ...] = ()
    children: tuple[str, ...] = ()

    @property
    def is_seen(self) -> bool:
        return bool(self.shapes) and self.transforms is not None


class OtherRobots:
    """Robots by their namespaces. One is seen once its description and its transforms are known, and from then on.

    Their clocks are not ours: each stands where its newest transforms say, whatever their stamps.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._robots = {name: _Robot() for name in names}

    @property
    def shapes(self) -> tuple[tuple[Shape, ...], ...]:
        """Of each robot, in the order of the names; none of those that are not seen yet. Links are `robot_b/hip`."""
        return tuple(robot.shapes if robot.is_seen else () for robot in self._robots.values())

    def set_robot(self, name: str, description: RobotDescription) -> None:
        """Takes a robot's visible shapes.

        Raises:
            InputFileError: the URDF is malformed.
        """
        model = parse_urdf(description.urdf, f"{name}/robot_description")
        shapes = tuple(
            replace(shape, link=f"{name}/{shape.link}", name=f"{name}/{shape.name or shape.link}")
            for shape in model.shapes
        )
        robot = self._robots[name]
        is_placed = robot.transforms is not None and _has_links(name, robot.transforms, shapes)
        self._robots[name] = replace(robot, shapes=shapes) if is_placed else _Robot(shapes)

    def place(self, name: str, transforms: Transforms) -> bool:
        """Takes where a robot is; returns whether it is seen from now on and was not before.

        Raises:
            MessageError: they do not begin at `world`, or leave out a link that can be seen.
        """
        robot = self._robots[name]
        if robot.transforms is not None and _same_tree(robot.transforms, transforms):
            self._robots[name] = replace(robot, transforms=transforms)
            return False
        if transforms.frame != _WORLD:
            raise MessageError(f"{name}: its transforms begin at '{transforms.frame}', must begin at '{_WORLD}'")
        if not _has_links(name, transforms, robot.shapes):
            raise MessageError(f"{name}: its transforms do not reach every link of its robot_description")
        self._robots[name] = _Robot(
            robot.shapes,
            transforms,
            tuple(parent if parent == _WORLD else f"{name}/{parent}" for parent in transforms.parents),
            tuple(f"{name}/{child}" for child in transforms.children),
        )
        return not robot.is_seen and self._robots[name].is_seen

    def joined(self, transforms: Transforms) -> Transforms:
        """Our own transforms, and with them those of the others that are seen."""
        seen = [(robot, robot.transforms) for robot in self._robots.values() if robot.shapes and robot.transforms]
        if not seen:
            return transforms
        return replace(
            transforms,
            parents=sum((robot.parents for robot, _ in seen), transforms.parents),
            children=sum((robot.children for robot, _ in seen), transforms.children),
            T_parent_child=np.concatenate([transforms.T_parent_child, *(its.T_parent_child for _, its in seen)]),
        )


def _same_tree(a: Transforms, b: Transforms) -> bool:
    return (a.frame, a.parents, a.children) == (b.frame, b.parents, b.children)


def _has_links(name: str, transforms: Transforms, shapes: tuple[Shape, ...]) -> bool:
    """Whether each of the shapes' links is connected with the root."""
    tree = FrameTree(transforms)
    try:
        for link in dict.fromkeys(shape.link for shape in shapes):
            tree.pose(link.removeprefix(f"{name}/"))
    except MessageError:
        return False
    return True
