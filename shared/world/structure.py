"""The steel structure: bars in the world, read from YAML, and written as URDF for the viewer and the sensors."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from shared.errors import ConfigError, InputFileError
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.solids import Box, Cylinder, Mesh, Vector3

ROOT_LINK = "world"
"""The structure stands still in the world, so its one link is the world frame itself."""
_GROUND_MARGIN_M = 10.0
"""How far the ground reaches beyond the structure: the range of the sensors."""
_GROUND_THICKNESS_M = 0.1
_COLOURS = {"weathered_steel": "0.46 0.48 0.50 1", "ground": "0.13 0.14 0.14 1"}


@dataclass(frozen=True, slots=True)
class Member:
    """One piece of steel: a bar or plate (Box), a tube (Cylinder), or a part of any shape (Mesh)."""

    name: str
    solid: Box | Cylinder | Mesh
    T_world_member: SE3


@dataclass(frozen=True, slots=True)
class Structure:
    """All members, and the height of the flat ground, None where there is none."""

    name: str
    members: tuple[Member, ...]
    ground_z_m: float | None


def load_structure(path: Path) -> Structure:
    """The structure of a YAML file: name, ground_z_m, and bars of name, centre_m, size_m and optional rpy_deg.

    Raises:
        InputFileError: the file cannot be read or is not YAML.
        ConfigError: with one line for each problem: file, element, rule, value.
    """
    try:
        tree = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
        entry = _StructureEntry.model_validate(tree)
    except ValidationError as error:
        raise ConfigError([f"{path}: {_problem_text(details)}" for details in error.errors()]) from error
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror or error}") from error
    except (YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f":{mark.line + 1}" if mark is not None else ""
        raise InputFileError(f"{path}{place}: not valid YAML: {getattr(error, 'problem', None) or error}") from error
    counts = Counter(bar.name for bar in entry.bars)
    if problems := [f"{path}: bar '{name}': defined {n} times" for name, n in counts.items() if n > 1]:
        raise ConfigError(problems)
    return Structure(entry.name, tuple(_member(bar) for bar in entry.bars), entry.ground_z_m)


def structure_urdf(structure: Structure) -> str:
    """The structure and its ground as a URDF document of one link, whose frame is the world's."""
    robot = ET.Element("robot", name=structure.name)
    for material, rgba in _COLOURS.items():
        ET.SubElement(ET.SubElement(robot, "material", name=material), "color", rgba=rgba)
    link = ET.SubElement(robot, "link", name=ROOT_LINK)
    for member in structure.members:
        _add_solid(link, member.name, member.solid, member.T_world_member, "weathered_steel")
    if structure.ground_z_m is not None:
        _add_solid(link, "ground", *_ground(structure, structure.ground_z_m), "ground")
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")


def _ground(structure: Structure, ground_z_m: float) -> tuple[Box, SE3]:
    """A flat box and its pose whose top is the ground, under the structure and around it."""
    centres = np.array([member.T_world_member.translation for member in structure.members])
    reaches = np.array([_reach_m(member.solid) for member in structure.members])[:, np.newaxis]
    low = (centres - reaches).min(axis=0) - _GROUND_MARGIN_M
    high = (centres + reaches).max(axis=0) + _GROUND_MARGIN_M
    x, y = ((low + high) / 2)[:2].tolist()
    width, depth = (high - low)[:2].tolist()
    pose = SE3.trans(x, y, ground_z_m - _GROUND_THICKNESS_M / 2)
    return Box((width, depth, _GROUND_THICKNESS_M)), pose


def _reach_m(solid: Box | Cylinder | Mesh) -> float:
    """How far a solid reaches from its frame's origin."""
    return float(np.linalg.norm(mesh_of(solid).vertices_m, axis=1).max())


def _add_solid(link: ET.Element, name: str, solid: Box | Cylinder | Mesh, T_link_solid: SE3, material: str) -> None:
    visual = ET.SubElement(link, "visual", name=name)
    ET.SubElement(visual, "origin", xyz=_words(T_link_solid.translation), rpy=_words(_rpy_rad(T_link_solid)))
    geometry = ET.SubElement(visual, "geometry")
    match solid:
        case Box(size_m):
            ET.SubElement(geometry, "box", size=_words(size_m))
        case Cylinder(radius_m, length_m):
            ET.SubElement(geometry, "cylinder", radius=_words([radius_m]), length=_words([length_m]))
        case Mesh(file=file, scale=scale):
            ET.SubElement(geometry, "mesh", filename=f"file://{file}", scale=_words(scale))
    ET.SubElement(visual, "material", name=material)


def _words(values: Any) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)  # + 0.0 turns -0.0 into 0.0


def _rpy_rad(T: SE3) -> Vector3:
    """Fixed-axis roll, pitch, yaw. Yaw is undone before roll is read, which stays exact at pitch +-90 degrees."""
    R = T.rotation
    yaw = math.atan2(R[1, 0], R[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return roll, pitch, yaw


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")]
_Length = Annotated[float, Field(gt=0, le=1000)]


class _BarEntry(_Entry):
    name: _Name
    centre_m: Vector3
    size_m: tuple[_Length, _Length, _Length]
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)


class _StructureEntry(_Entry):
    name: _Name
    ground_z_m: float | None = None
    bars: list[_BarEntry] = Field(min_length=1)


def _member(entry: _BarEntry) -> Member:
    return Member(entry.name, Box(entry.size_m), SE3.from_rpy(np.deg2rad(entry.rpy_deg), entry.centre_m))


def _problem_text(details: Any) -> str:
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in details["loc"]).lstrip(".")
    rule = "unknown key" if details["type"] == "extra_forbidden" else str(details["msg"]).removeprefix("Input ")
    shown = "" if details["type"] in ("missing", "extra_forbidden") else f", got {details['input']!r:.80}"
    return f"{place or 'document'}: {rule}{shown}"
