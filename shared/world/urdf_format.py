"""Structures as URDF: written for the viewer and the sensors, read from files of others."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from shared.errors import InputFileError
from shared.files import read_text
from shared.geometry import SE3
from shared.mesh_files import mesh_uri
from shared.meshes import mesh_of
from shared.robot.description import Joint, Shape, UrdfModel
from shared.robot.urdf import parse_urdf
from shared.solids import Box, Cylinder, Mesh, Sphere
from shared.world.structure import Member, Structure, unique_names
from shared.xml_reading import words

ROOT_LINK = "world"
"""The structure stands still in the world, so its one link is the world frame itself."""
GROUND = "ground"
"""Name of the box whose top is the ground."""
_GROUND_MARGIN_M = 10.0
"""How far the ground reaches beyond the structure: the range of the sensors."""
_GROUND_THICKNESS_M = 0.1
_COLOURS = {"weathered_steel": "0.46 0.48 0.50 1", "ground": "0.13 0.14 0.14 1"}


def structure_urdf(structure: Structure) -> str:
    """The structure and its ground as a URDF document of one link, whose frame is the world's.

    Raises:
        ValueError: a mesh that was not read from a file.
    """
    robot = ET.Element("robot", name=structure.name)
    for material, rgba in _COLOURS.items():
        ET.SubElement(ET.SubElement(robot, "material", name=material), "color", rgba=rgba)
    link = ET.SubElement(robot, "link", name=ROOT_LINK)
    for member in structure.members:
        _add_solid(link, member, "weathered_steel")
    if structure.ground_z_m is not None:
        _add_solid(link, _ground(structure, structure.ground_z_m), "ground")
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")


def read_urdf_structure(path: Path) -> Structure:
    """The structure of a URDF file: its links with all joints at zero, the root link's frame being the world's.

    Of each link the collision shapes count, or the visual ones where there are none. A level box of the root link that
    is called "ground" is the ground.

    Raises:
        InputFileError: naming file, element and reason.
    """
    model = parse_urdf(read_text(path), str(path), path.parent)
    T_world_link = _link_poses(model)
    touched = {shape.link for shape in model.collisions}
    shapes = [*model.collisions, *(shape for shape in model.shapes if shape.link not in touched)]
    grounds = [shape for shape in shapes if _is_ground(shape, model.root)]
    shapes = [shape for shape in shapes if not _is_ground(shape, model.root)]
    names = unique_names(shape.name or shape.link for shape in shapes)
    members = tuple(_member(shape, name, T_world_link, path) for shape, name in zip(shapes, names, strict=True))
    (name,) = unique_names([model.name or path.stem])
    return Structure(name, members, _top_m(grounds[0]) if grounds else None)


def _link_poses(model: UrdfModel) -> dict[str, SE3]:
    poses = {model.root: SE3.identity()}
    joints: dict[str, list[Joint]] = {}
    for joint in model.joints:
        joints.setdefault(joint.parent, []).append(joint)
    for link in (waiting := [model.root]):  # it grows by the children of each link
        for joint in joints.get(link, ()):
            poses[joint.child] = poses[link] @ joint.T_parent_child()
            waiting.append(joint.child)
    return poses


def _is_ground(shape: Shape, root: str) -> bool:
    is_level = abs(shape.T_link_shape.rotation[2, 2] - 1) < 1e-9
    return shape.name == GROUND and shape.link == root and isinstance(shape.solid, Box) and is_level


def _top_m(ground: Shape) -> float:
    assert isinstance(ground.solid, Box)
    return float(ground.T_link_shape.translation[2]) + ground.solid.size_m[2] / 2


def _member(shape: Shape, name: str, T_world_link: dict[str, SE3], path: Path) -> Member:
    if isinstance(shape.solid, Sphere):
        raise InputFileError(f"{path}: link '{shape.link}': a structure is of boxes, cylinders and meshes, not spheres")
    return Member(name, shape.solid, T_world_link[shape.link] @ shape.T_link_shape)


def _ground(structure: Structure, ground_z_m: float) -> Member:
    """A flat box whose top is the ground, under the structure and around it."""
    centres = np.array([member.T_world_member.translation for member in structure.members])
    reaches = np.array([_reach_m(member.solid) for member in structure.members])[:, np.newaxis]
    low = (centres - reaches).min(axis=0) - _GROUND_MARGIN_M
    high = (centres + reaches).max(axis=0) + _GROUND_MARGIN_M
    x, y = ((low + high) / 2)[:2].tolist()
    width, depth = (high - low)[:2].tolist()
    pose = SE3.trans(x, y, ground_z_m - _GROUND_THICKNESS_M / 2)
    return Member(GROUND, Box((width, depth, _GROUND_THICKNESS_M)), pose)


def _reach_m(solid: Box | Cylinder | Mesh) -> float:
    """How far a solid reaches from its frame's origin."""
    return float(np.linalg.norm(mesh_of(solid).vertices_m, axis=1).max())


def _add_solid(link: ET.Element, member: Member, material: str) -> None:
    T = member.T_world_member
    visual = ET.SubElement(link, "visual", name=member.name)
    ET.SubElement(visual, "origin", xyz=words(T.translation), rpy=words(T.rpy_rad))
    geometry = ET.SubElement(visual, "geometry")
    match member.solid:
        case Box(size_m):
            ET.SubElement(geometry, "box", size=words(size_m))
        case Cylinder(radius_m, length_m):
            ET.SubElement(geometry, "cylinder", radius=words([radius_m]), length=words([length_m]))
        case Mesh(scale=scale) as mesh:
            try:
                ET.SubElement(geometry, "mesh", filename=mesh_uri(mesh), scale=words(scale))
            except ValueError as error:
                raise ValueError(f"member '{member.name}': {error}") from error
    ET.SubElement(visual, "material", name=material)
