"""Structures as YAML: lists of bars, plates, tubes and meshes, a line each."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from shared.errors import ConfigError, InputFileError
from shared.files import read_text
from shared.geometry import SE3
from shared.mesh_files import MAX_COORDINATE_M, mesh_uri, read_mesh
from shared.solids import Box, Cylinder, Mesh, Solid, Vector3
from shared.world.structure import MAX_LENGTH_M, Member, Structure
from shared.yaml_reading import YamlError, load_yaml

_PLATE_THINNESS = 0.25
"""A box is written as a plate if its thickness is less than this part of its width."""


def read_yaml_structure(path: Path) -> Structure:
    """The structure of a YAML file: name, ground_z_m, and at least one of bars, plates, tubes, meshes.

    Raises:
        InputFileError: the file, or that of a mesh, cannot be read or is not what it should be.
        ConfigError: with one line for each problem: file, element, rule, value.
    """
    try:
        entry = _StructureEntry.model_validate(load_yaml(read_text(path), str(path)))
    except ValidationError as error:
        raise ConfigError([f"{path}: {_problem_text(details)}" for details in error.errors()]) from error
    except YamlError as error:
        raise InputFileError(str(error)) from error
    counts = Counter(part.name for part in entry.parts())
    if problems := [f"{path}: bar '{name}': defined {n} times" for name, n in counts.items() if n > 1]:
        raise ConfigError(problems)
    members = tuple(Member(part.name, _solid(part, path), part.T_world()) for part in entry.parts())
    return Structure(entry.name, members, entry.ground_z_m)


def structure_yaml(structure: Structure) -> str:
    """The structure as a YAML document that reads back as the same; thin boxes are written as plates.

    Raises:
        ValueError: a mesh that was not read from a file.
    """
    lines = [f"name: {json.dumps(structure.name)}"]
    if structure.ground_z_m is not None:
        lines.append(f"ground_z_m: {structure.ground_z_m!r}")
    parts: dict[str, list[str]] = {"bars": [], "plates": [], "tubes": [], "meshes": []}
    for member in structure.members:
        parts[_list_name(member.solid)].append(f"  - {_line(member)}")
    for key, entries in parts.items():
        lines += [f"{key}:", *entries] if entries else []
    return "\n".join(lines) + "\n"


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")]
_Length = Annotated[float, Field(gt=0, le=MAX_LENGTH_M)]
_Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
_Factor = Annotated[float, Field(gt=0)]


class _PartEntry(_Entry):
    name: _Name
    centre_m: tuple[_Coordinate, _Coordinate, _Coordinate]
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)

    def T_world(self) -> SE3:
        return SE3.from_rpy(np.deg2rad(self.rpy_deg), self.centre_m)


class _BoxEntry(_PartEntry):
    size_m: tuple[_Length, _Length, _Length]


class _TubeEntry(_PartEntry):
    radius_m: _Length
    length_m: _Length


class _MeshEntry(_PartEntry):
    """centre_m: where the origin of the file's coordinates is. scale: what they are multiplied by to be metres."""

    file: Path
    scale: _Factor | tuple[_Factor, _Factor, _Factor] = 1.0
    centre_m: tuple[_Coordinate, _Coordinate, _Coordinate] = (0.0, 0.0, 0.0)


class _StructureEntry(_Entry):
    name: _Name
    ground_z_m: _Coordinate | None = None
    bars: Annotated[list[_BoxEntry], Field(min_length=1)] | None = None
    plates: list[_BoxEntry] = []
    tubes: list[_TubeEntry] = []
    meshes: list[_MeshEntry] = []

    def parts(self) -> Iterator[_BoxEntry | _TubeEntry | _MeshEntry]:
        for entries in (self.bars or [], self.plates, self.tubes, self.meshes):
            yield from entries


def _solid(part: _BoxEntry | _TubeEntry | _MeshEntry, path: Path) -> Box | Cylinder | Mesh:
    match part:
        case _BoxEntry():
            return Box(part.size_m)
        case _TubeEntry():
            return Cylinder(part.radius_m, part.length_m)
    scale = part.scale if isinstance(part.scale, tuple) else (part.scale,) * 3
    try:
        return read_mesh(path.parent / part.file, scale)
    except InputFileError as error:
        raise InputFileError(f"{path}: mesh '{part.name}': {error}") from error


def _problem_text(details: Any) -> str:
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in details["loc"]).lstrip(".")
    rule = "unknown key" if details["type"] == "extra_forbidden" else str(details["msg"]).removeprefix("Input ")
    shown = "" if details["type"] in ("missing", "extra_forbidden") else f", got {details['input']!r:.80}"
    return f"{place or 'document'}: {rule}{shown}"


def _list_name(solid: Solid) -> str:
    match solid:
        case Box(size_m):
            thickness, width, _ = sorted(size_m)
            return "plates" if thickness < _PLATE_THINNESS * width else "bars"
        case Cylinder():
            return "tubes"
    return "meshes"


def _line(member: Member) -> str:
    T = member.T_world_member
    fields = {"name": json.dumps(member.name), "centre_m": _numbers(T.translation)}
    match member.solid:
        case Box(size_m):
            fields["size_m"] = _numbers(size_m)
        case Cylinder(radius_m, length_m):
            fields |= {"radius_m": repr(float(radius_m)), "length_m": repr(float(length_m))}
        case Mesh(file=file, scale=scale) as mesh:
            try:
                mesh_uri(mesh)
            except ValueError as error:
                raise ValueError(f"member '{member.name}': {error}") from error
            fields |= {"file": json.dumps(str(file)), "scale": _numbers(scale)}
    if any(T.rpy_rad):
        fields["rpy_deg"] = _numbers(np.rad2deg(T.rpy_rad))
    return "{" + ", ".join(f"{key}: {value}" for key, value in fields.items()) + "}"


def _numbers(values: Any) -> str:
    return "[" + ", ".join(repr(float(value) + 0.0) for value in values) + "]"
