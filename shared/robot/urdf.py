"""Reads URDF, strictly: what is missing, malformed or not a tree is an error that names the element.

Written on xml.etree: the libraries for URDF bring trimesh and a dozen packages more, for meshes which we do not use.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from shared.errors import InputFileError
from shared.geometry import SE3
from shared.robot.description import Inertia, Joint, Limits, Shape, UrdfModel
from shared.solids import Box, Cylinder, Solid, Sphere, Vector3


def read_urdf(path: Path) -> str:
    """The text of a URDF file.

    Raises:
        InputFileError: it cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputFileError(f"{path}: {error}") from error


def parse_urdf(text: str, source: str) -> UrdfModel:
    """The model of a URDF document; `source` names it in errors (a file or a channel).

    Raises:
        InputFileError: naming source, element and reason.
    """
    try:
        return _model(text)
    except (ET.ParseError, _UrdfError) as error:
        raise InputFileError(f"{source}: {error}") from error


class _UrdfError(ValueError):
    """What is wrong, without the document's name."""


def _model(text: str) -> UrdfModel:
    if "<!DOCTYPE" in text:
        raise _UrdfError("a document type declaration is not allowed in URDF")
    robot = ET.fromstring(text)  # noqa: S314 - without a document type there are no entities to expand
    if robot.tag != "robot":
        raise _UrdfError(f"the root element must be <robot>, is <{robot.tag}>")
    links = tuple(_text(link, "name", "link") for link in robot.findall("link"))
    joints = tuple(_joint(element) for element in robot.findall("joint"))
    _refuse_duplicates("link", links)
    _refuse_duplicates("joint", [joint.name for joint in joints])
    return UrdfModel(
        name=robot.get("name", ""),
        root=_root(links, joints),
        links=links,
        joints=joints,
        shapes=_shapes(robot, "visual"),
        collisions=_shapes(robot, "collision"),
        inertias={
            link.get("name", ""): _inertia(link, inertial)
            for link in robot.findall("link")
            for inertial in link.findall("inertial")
        },
    )


def _refuse_duplicates(what: str, names: Iterable[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise _UrdfError(f"{what} '{name}': defined {count} times")


def _root(links: tuple[str, ...], joints: tuple[Joint, ...]) -> str:
    children: dict[str, list[str]] = {link: [] for link in links}
    parent_joint: dict[str, str] = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in children:
                raise _UrdfError(f"joint '{joint.name}': no link '{link}'; links are {', '.join(links)}")
        if joint.child in parent_joint:
            raise _UrdfError(f"link '{joint.child}': child of both '{parent_joint[joint.child]}' and '{joint.name}'")
        parent_joint[joint.child] = joint.name
        children[joint.parent].append(joint.child)
    roots = [link for link in links if link not in parent_joint]
    if len(roots) != 1:
        raise _UrdfError(f"there must be one root link, there are {len(roots)}: {', '.join(roots) or 'a cycle'}")
    reached = list(roots)
    for link in reached:
        reached += children[link]
    if len(reached) != len(links):
        raise _UrdfError(f"links in a cycle: {', '.join(link for link in links if link not in reached)}")
    return roots[0]


def _joint(element: ET.Element) -> Joint:
    name = _text(element, "name", "joint")
    where = f"joint '{name}'"
    kind = _text(element, "type", where)
    if kind not in ("revolute", "continuous", "prismatic", "fixed"):
        raise _UrdfError(f"{where}: type '{kind}' is not supported; use revolute, continuous, prismatic or fixed")
    axis = np.array(_vector(element.find("axis"), "xyz", (1.0, 0.0, 0.0), where))
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise _UrdfError(f"{where}: axis must not be zero")
    x, y, z = (axis / length).tolist()
    return Joint(
        name=name,
        kind=kind,
        parent=_text(_child(element, "parent", where), "link", f"{where}: parent"),
        child=_text(_child(element, "child", where), "link", f"{where}: child"),
        T_parent_joint=_origin(element, where),
        axis=(x, y, z),
        limits=None if kind == "fixed" else _limits(element, kind, where),
    )


def _limits(element: ET.Element, kind: str, where: str) -> Limits:
    limit = _child(element, "limit", where)
    where = f"{where}: limit"
    is_bounded = kind != "continuous"
    lower = _number(limit, "lower", where) if is_bounded else -math.inf
    upper = _number(limit, "upper", where) if is_bounded else math.inf
    if lower > upper:
        raise _UrdfError(f"{where}: lower {lower:g} is above upper {upper:g}")
    effort = _positive(limit, "effort", where) if limit.get("effort") else math.inf
    return Limits(lower, upper, _positive(limit, "velocity", where), effort)


def _inertia(link: ET.Element, inertial: ET.Element) -> Inertia:
    where = f"link '{link.get('name', '')}': inertial"
    mass_kg = _number(_child(inertial, "mass", where), "value", f"{where}: mass")
    if mass_kg < 0:
        raise _UrdfError(f"{where}: mass must not be negative, got {mass_kg:g}")
    inertia = _child(inertial, "inertia", where)
    xx, xy, xz, yy, yz, zz = (_number(inertia, f"i{key}", where) for key in ("xx", "xy", "xz", "yy", "yz", "zz"))
    moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if np.linalg.eigvalsh(moments).min() < 0:
        raise _UrdfError(f"{where}: inertia must be positive semi-definite")
    return Inertia(mass_kg, _origin(inertial, where), moments)


def _shapes(robot: ET.Element, kind: str) -> tuple[Shape, ...]:
    return tuple(_shape(link, shape, kind) for link in robot.findall("link") for shape in link.findall(kind))


def _shape(link: ET.Element, element: ET.Element, kind: str) -> Shape:
    name = link.get("name", "")
    where = f"link '{name}': {kind}"
    geometries = list(_child(element, "geometry", where))
    tag = geometries[0].tag if len(geometries) == 1 else f"{len(geometries)} elements"
    solid: Solid
    if tag == "box":
        size = _vector(geometries[0], "size", None, f"{where}: box")
        if min(size) <= 0:
            raise _UrdfError(f"{where}: box: size must be positive, got {size}")
        solid = Box(size)
    elif tag == "cylinder":
        radius, length = (_positive(geometries[0], key, f"{where}: cylinder") for key in ("radius", "length"))
        solid = Cylinder(radius, length)
    elif tag == "sphere":
        solid = Sphere(_positive(geometries[0], "radius", f"{where}: sphere"))
    else:
        raise _UrdfError(f"{where}: geometry must be one box, cylinder or sphere, is {tag}")
    return Shape(name, solid, _origin(element, where), element.get("name", ""))


def _origin(element: ET.Element, where: str) -> SE3:
    origin = element.find("origin")
    zero = (0.0, 0.0, 0.0)
    return SE3.from_rpy(_vector(origin, "rpy", zero, where), _vector(origin, "xyz", zero, where))


def _child(element: ET.Element, tag: str, where: str) -> ET.Element:
    child = element.find(tag)
    if child is None:
        raise _UrdfError(f"{where}: <{tag}> is missing")
    return child


def _text(element: ET.Element, key: str, where: str) -> str:
    value = element.get(key)
    if not value:
        raise _UrdfError(f"{where}: attribute '{key}' is missing")
    return value


def _number(element: ET.Element, key: str, where: str) -> float:
    return _finite(_text(element, key, where), 1, f"{where}: {key}")[0]


def _positive(element: ET.Element, key: str, where: str) -> float:
    value = _number(element, key, where)
    if value <= 0:
        raise _UrdfError(f"{where}: {key} must be positive, got {value:g}")
    return value


def _vector(element: ET.Element | None, key: str, default: Vector3 | None, where: str) -> Vector3:
    if default is not None and (element is None or element.get(key) is None):
        return default
    assert element is not None
    x, y, z = _finite(_text(element, key, where), 3, f"{where}: {key}")
    return x, y, z


def _finite(text: str, count: int, where: str) -> list[float]:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise _UrdfError(f"{where}: needs {count} finite number{'s' if count > 1 else ''}, got '{text}'")
    return values
