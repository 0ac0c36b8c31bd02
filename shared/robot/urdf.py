"""Reads URDF, strictly: what is missing, malformed or not a tree is an error that names the element.

Written on xml.etree: the libraries for URDF bring a dozen packages more and repair silently.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from shared.errors import InputFileError
from shared.files import read_text
from shared.geometry import SE3
from shared.mesh_files import mesh_path, read_mesh
from shared.robot.description import Inertia, Joint, Limits, Shape, UrdfModel
from shared.solids import Box, Cylinder, Mesh, Solid, Sphere
from shared.xml_reading import (
    XmlError,
    all_positive,
    attribute,
    child_of,
    number,
    positive,
    refuse_duplicates,
    root_of,
    vector,
)


def read_urdf(path: Path) -> str:
    """The text of a URDF file.

    Raises:
        InputFileError: it cannot be read.
    """
    return read_text(path)


def parse_urdf(text: str, source: str, folder: Path | None = None) -> UrdfModel:
    """The model of a URDF document; `source` names it in errors (a file or a channel).

    folder: where the relative paths of its meshes begin; without one they must be absolute.

    Raises:
        InputFileError: naming source, element and reason.
    """
    try:
        return _model(text, folder)
    except XmlError as error:
        raise InputFileError(f"{source}: {error}") from error


def _model(text: str, folder: Path | None) -> UrdfModel:
    robot = root_of(text, "robot")
    links = tuple(attribute(link, "name", "link") for link in robot.findall("link"))
    joints = tuple(_joint(element) for element in robot.findall("joint"))
    refuse_duplicates("link", links)
    refuse_duplicates("joint", [joint.name for joint in joints])
    return UrdfModel(
        name=robot.get("name", ""),
        root=_root(links, joints),
        links=links,
        joints=joints,
        shapes=_shapes(robot, "visual", folder),
        collisions=_shapes(robot, "collision", folder),
        inertias={
            link.get("name", ""): _inertia(link, inertial)
            for link in robot.findall("link")
            for inertial in link.findall("inertial")
        },
    )


def _root(links: tuple[str, ...], joints: tuple[Joint, ...]) -> str:
    children: dict[str, list[str]] = {link: [] for link in links}
    parent_joint: dict[str, str] = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in children:
                raise XmlError(f"joint '{joint.name}': no link '{link}'; links are {', '.join(links)}")
        if joint.child in parent_joint:
            raise XmlError(f"link '{joint.child}': child of both '{parent_joint[joint.child]}' and '{joint.name}'")
        parent_joint[joint.child] = joint.name
        children[joint.parent].append(joint.child)
    roots = [link for link in links if link not in parent_joint]
    if len(roots) != 1:
        raise XmlError(f"there must be one root link, there are {len(roots)}: {', '.join(roots) or 'a cycle'}")
    reached = list(roots)
    for link in reached:
        reached += children[link]
    if len(reached) != len(links):
        raise XmlError(f"links in a cycle: {', '.join(link for link in links if link not in reached)}")
    return roots[0]


def _joint(element: ET.Element) -> Joint:
    name = attribute(element, "name", "joint")
    where = f"joint '{name}'"
    kind = attribute(element, "type", where)
    if kind not in ("revolute", "continuous", "prismatic", "fixed"):
        raise XmlError(f"{where}: type '{kind}' is not supported; use revolute, continuous, prismatic or fixed")
    axis = np.array(vector(element.find("axis"), "xyz", (1.0, 0.0, 0.0), where))
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise XmlError(f"{where}: axis must not be zero")
    x, y, z = (axis / length).tolist()
    return Joint(
        name=name,
        kind=kind,
        parent=attribute(child_of(element, "parent", where), "link", f"{where}: parent"),
        child=attribute(child_of(element, "child", where), "link", f"{where}: child"),
        T_parent_joint=_origin(element, where),
        axis=(x, y, z),
        limits=None if kind == "fixed" else _limits(element, kind, where),
    )


def _limits(element: ET.Element, kind: str, where: str) -> Limits:
    limit = child_of(element, "limit", where)
    where = f"{where}: limit"
    is_bounded = kind != "continuous"
    lower = number(limit, "lower", where) if is_bounded else -math.inf
    upper = number(limit, "upper", where) if is_bounded else math.inf
    if lower > upper:
        raise XmlError(f"{where}: lower {lower:g} is above upper {upper:g}")
    effort = positive(limit, "effort", where) if limit.get("effort") else math.inf
    return Limits(lower, upper, positive(limit, "velocity", where), effort)


def _inertia(link: ET.Element, inertial: ET.Element) -> Inertia:
    where = f"link '{link.get('name', '')}': inertial"
    mass_kg = number(child_of(inertial, "mass", where), "value", f"{where}: mass")
    if mass_kg < 0:
        raise XmlError(f"{where}: mass must not be negative, got {mass_kg:g}")
    inertia = child_of(inertial, "inertia", where)
    xx, xy, xz, yy, yz, zz = (number(inertia, f"i{key}", where) for key in ("xx", "xy", "xz", "yy", "yz", "zz"))
    moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if np.linalg.eigvalsh(moments).min() < 0:
        raise XmlError(f"{where}: inertia must be positive semi-definite")
    return Inertia(mass_kg, _origin(inertial, where), moments)


def _shapes(robot: ET.Element, kind: str, folder: Path | None) -> tuple[Shape, ...]:
    return tuple(_shape(link, shape, kind, folder) for link in robot.findall("link") for shape in link.findall(kind))


def _shape(link: ET.Element, element: ET.Element, kind: str, folder: Path | None) -> Shape:
    name = link.get("name", "")
    where = f"link '{name}': {kind}"
    geometries = list(child_of(element, "geometry", where))
    if len(geometries) != 1:
        raise XmlError(f"{where}: geometry must be one box, cylinder, sphere or mesh, is {len(geometries)} elements")
    material = element.find("material")
    return Shape(
        name,
        _solid(geometries[0], where, folder),
        _origin(element, where),
        element.get("name", ""),
        "" if material is None else material.get("name", ""),
    )


def _solid(element: ET.Element, where: str, folder: Path | None) -> Solid:
    at = f"{where}: {element.tag}"
    match element.tag:
        case "box":
            size = vector(element, "size", None, at)
            all_positive(list(size), f"{at}: size")
            return Box(size)
        case "cylinder":
            return Cylinder(positive(element, "radius", at), positive(element, "length", at))
        case "sphere":
            return Sphere(positive(element, "radius", at))
        case "mesh":
            return _mesh(element, at, folder)
    raise XmlError(f"{where}: geometry must be one box, cylinder, sphere or mesh, is {element.tag}")


def _mesh(element: ET.Element, where: str, folder: Path | None) -> Mesh:
    scale = vector(element, "scale", (1.0, 1.0, 1.0), where)
    try:
        return read_mesh(mesh_path(attribute(element, "filename", where), folder), scale)
    except (ValueError, InputFileError) as error:
        raise XmlError(f"{where}: {error}") from error


def _origin(element: ET.Element, where: str) -> SE3:
    origin = element.find("origin")
    zero = (0.0, 0.0, 0.0)
    return SE3.from_rpy(vector(origin, "rpy", zero, where), vector(origin, "xyz", zero, where))
