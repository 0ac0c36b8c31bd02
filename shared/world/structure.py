"""A steel structure as values: bars, plates, tubes and other parts that stand still in the world."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from shared.geometry import SE3
from shared.mesh_files import MAX_COORDINATE_M
from shared.solids import Box, Cylinder, Mesh

MAX_LENGTH_M = 1000.0
"""Of one bar: a longer one is a wrong unit."""


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


def problems_of(structure: Structure) -> list[str]:
    """What makes a structure unusable, a line each, naming the member: none, twice the same name, beyond limits."""
    problems = [] if structure.members else ["there is no box, cylinder or mesh in it"]
    counts = Counter(member.name for member in structure.members)
    problems += [f"member '{name}': defined {count} times" for name, count in counts.items() if count > 1]
    for member in structure.members:
        if (far_m := float(np.abs(member.T_world_member.translation).max())) > MAX_COORDINATE_M:
            problems.append(f"member '{member.name}': is {far_m:g} m away, at most {MAX_COORDINATE_M:g} m is allowed")
        if not 0 < min(lengths := _lengths_m(member.solid)) <= max(lengths) <= MAX_LENGTH_M:
            size = " ".join(f"{length:g}" for length in lengths)
            problems.append(f"member '{member.name}': size {size} m is not between 0 and {MAX_LENGTH_M:g} m")
    if structure.ground_z_m is not None and abs(structure.ground_z_m) > MAX_COORDINATE_M:
        problems.append(f"ground at {structure.ground_z_m:g} m, at most {MAX_COORDINATE_M:g} m is allowed")
    return problems


def unique_names(raw_names: Iterable[str]) -> list[str]:
    """Names of letters, digits and _.- alone, in the same order; one that is taken gets a number behind it."""
    names: dict[str, None] = {}
    numbers: Counter[str] = Counter()
    for raw in raw_names:
        name = candidate = re.sub(r"[^A-Za-z0-9_.-]+", "_", raw).strip("_") or "member"
        while candidate in names:
            numbers[name] += 1
            candidate = f"{name}_{numbers[name] + 1}"
        names[candidate] = None
    return list(names)


def _lengths_m(solid: Box | Cylinder | Mesh) -> tuple[float, ...]:
    match solid:
        case Box(size_m):
            return size_m
        case Cylinder(radius_m, length_m):
            return radius_m, length_m
        case Mesh():
            return (1.0,)  # its reader checks it, and a mesh may be a whole structure
