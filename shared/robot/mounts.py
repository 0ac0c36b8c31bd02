"""Puts sensors on the robot: the links and fixed joints that carry them, set in its URDF, which all else reads."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from shared.errors import InputFileError
from shared.geometry import SE3
from shared.xml_reading import XmlError, attribute, child_of, root_of, words

OPTICAL = "_optical"
T_BODY_OPTICAL = SE3.from_rpy((-np.pi / 2, 0.0, -np.pi / 2))
"""From x forward, y left, z up to z forward, x right, y down (REP-103)."""


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """Where a sensor's link is fixed. setting: who says so, for errors.

    The frame `NAME_optical` is that of a camera whose body is the link NAME: the mount places the body.
    """

    setting: str
    frame: str
    parent: str
    T_parent_body: SE3

    @property
    def body(self) -> str:
        """The link that the mount places."""
        return self.frame.removesuffix(OPTICAL)


def with_mounts(urdf: str, mounts: Sequence[Mount], source: str) -> str:
    """The URDF with each mount's link fixed where it says; without mounts the text as it is.

    An existing link keeps its shapes and its mass, and takes along what is fixed to it. A new one has neither. `source`
    names the document in errors.

    Raises:
        InputFileError: no such parent, a link that no fixed joint carries, one that would carry itself, or two places
            for one.
    """
    if not mounts:
        return urdf
    try:
        robot = root_of(urdf, "robot")
        _refuse_two_places(mounts)
        for mount in mounts:
            _add_missing_links(robot, mount)
        for mount in mounts:
            _fix(robot, mount)
        for mount in mounts:
            _refuse_cycle(robot, mount)
    except XmlError as error:
        raise InputFileError(f"{source}: {error}") from error
    ET.indent(robot)
    return f'<?xml version="1.0"?>\n{ET.tostring(robot, encoding="unicode")}\n'


def link_names(urdf: str, source: str) -> list[str]:
    """The links of a URDF document, in its order.

    Raises:
        InputFileError: it is no URDF, or a link has no name.
    """
    try:
        return _links(root_of(urdf, "robot"))
    except XmlError as error:
        raise InputFileError(f"{source}: {error}") from error


def _links(robot: ET.Element) -> list[str]:
    return [attribute(link, "name", "link") for link in robot.findall("link")]


def _refuse_two_places(mounts: Sequence[Mount]) -> None:
    settings: dict[str, str] = {}
    for mount in mounts:
        if mount.body in settings:
            raise XmlError(f"{mount.setting}: link '{mount.body}' is placed by {settings[mount.body]} too")
        settings[mount.body] = mount.setting


def _add_missing_links(robot: ET.Element, mount: Mount) -> None:
    if mount.body not in _links(robot):
        _add_link(robot, mount.body)
        _add_joint(robot, mount.parent, mount.body, mount.T_parent_body)
    if mount.frame not in _links(robot):
        _add_link(robot, mount.frame)
        _add_joint(robot, mount.body, mount.frame, T_BODY_OPTICAL)


def _add_link(robot: ET.Element, name: str) -> None:
    """Without a mass: stated, for some engines take a link that states none for one of 1 kg."""
    inertial = ET.SubElement(ET.SubElement(robot, "link", name=name), "inertial")
    ET.SubElement(inertial, "mass", value="0")
    ET.SubElement(inertial, "inertia", dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0"))


def _add_joint(robot: ET.Element, parent: str, child: str, T_parent_child: SE3) -> None:
    joint = ET.SubElement(robot, "joint", name=f"{child}_mount", type="fixed")
    ET.SubElement(joint, "parent")
    ET.SubElement(joint, "child", link=child)
    _set(joint, parent, T_parent_child)


def _fix(robot: ET.Element, mount: Mount) -> None:
    if mount.parent not in _links(robot):
        raise XmlError(f"{mount.setting}: no link '{mount.parent}'; links are {', '.join(_links(robot))}")
    joint = _joint_of(robot, mount.body)
    if joint is None or joint.get("type") != "fixed":
        carried = "is the root" if joint is None else f"moves by joint '{joint.get('name')}'"
        raise XmlError(f"{mount.setting}: link '{mount.body}' {carried}; a mount places what a fixed joint carries")
    _set(joint, mount.parent, mount.T_parent_body)


def _set(joint: ET.Element, parent: str, T_parent_child: SE3) -> None:
    child_of(joint, "parent", f"joint '{joint.get('name')}'").set("link", parent)
    for origin in joint.findall("origin"):
        joint.remove(origin)
    ET.SubElement(joint, "origin", xyz=words(T_parent_child.translation), rpy=words(T_parent_child.rpy_rad))


def _refuse_cycle(robot: ET.Element, mount: Mount) -> None:
    """Walks from the sensor's frame to the root; on its way must be the link that the mount places."""
    way = [mount.frame]
    while (joint := _joint_of(robot, way[-1])) is not None:
        way.append(_parent(joint))
        if way[-1] in way[:-1]:
            raise XmlError(f"{mount.setting}: link '{mount.body}' would carry itself: {' on '.join(way)}")
    if mount.body not in way:
        raise XmlError(f"{mount.setting}: link '{mount.frame}' must be on '{mount.body}', is {' on '.join(way)}")


def _joint_of(robot: ET.Element, link: str) -> ET.Element | None:
    """The joint that carries a link."""
    return next((joint for joint in robot.findall("joint") if _child(joint) == link), None)


def _child(joint: ET.Element) -> str:
    where = f"joint '{joint.get('name')}'"
    return attribute(child_of(joint, "child", where), "link", f"{where}: child")


def _parent(joint: ET.Element) -> str:
    where = f"joint '{joint.get('name')}'"
    return attribute(child_of(joint, "parent", where), "link", f"{where}: parent")
