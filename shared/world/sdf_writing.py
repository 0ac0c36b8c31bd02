"""Writes structures as SDF: a world with one static model a member, for Gazebo."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from shared.geometry import SE3
from shared.mesh_files import mesh_uri
from shared.solids import Box, Cylinder, Mesh
from shared.world.structure import Member, Structure, unique_names
from shared.xml_reading import words

_VERSION = "1.7"
"""What Gazebo 11 reads and writes; later ones read it too."""
_GROUND_SIZE_M = (1000.0, 1000.0)


def structure_sdf(structure: Structure) -> str:
    """The structure as an SDF world: a static model a member with the member's name, the ground as a plane.

    Raises:
        ValueError: a mesh that was not read from a file.
    """
    sdf = ET.Element("sdf", version=_VERSION)
    world = ET.SubElement(sdf, "world", name=structure.name)
    for member in structure.members:
        try:
            _add_model(world, member.name, member.T_world_member, _geometry(member))
        except ValueError as error:
            raise ValueError(f"member '{member.name}': {error}") from error
    if structure.ground_z_m is not None:
        plane = ET.Element("plane")
        ET.SubElement(plane, "normal").text = "0 0 1"
        ET.SubElement(plane, "size").text = words(_GROUND_SIZE_M)
        name = unique_names([*(member.name for member in structure.members), "ground_plane"])[-1]
        _add_model(world, name, SE3.trans(z_m=structure.ground_z_m), plane)
    ET.indent(sdf)
    return ET.tostring(sdf, encoding="unicode", xml_declaration=True) + "\n"


def _add_model(world: ET.Element, name: str, T_world_model: SE3, geometry: ET.Element) -> None:
    model = ET.SubElement(world, "model", name=name)
    ET.SubElement(model, "static").text = "true"
    ET.SubElement(model, "pose").text = words([*T_world_model.translation, *T_world_model.rpy_rad])
    link = ET.SubElement(model, "link", name="link")
    for kind in ("collision", "visual"):
        ET.SubElement(ET.SubElement(link, kind, name=kind), "geometry").append(geometry)


def _geometry(member: Member) -> ET.Element:
    element = ET.Element(type(member.solid).__name__.lower())
    match member.solid:
        case Box(size_m):
            ET.SubElement(element, "size").text = words(size_m)
        case Cylinder(radius_m, length_m):
            ET.SubElement(element, "radius").text = words([radius_m])
            ET.SubElement(element, "length").text = words([length_m])
        case Mesh(scale=scale) as mesh:
            ET.SubElement(element, "uri").text = mesh_uri(mesh)
            ET.SubElement(element, "scale").text = words(scale)
    return element
