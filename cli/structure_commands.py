"""`hyrecro structure`: make, show and convert structures."""

from __future__ import annotations

import math
from collections import Counter
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from shared.solids import Solid
    from shared.world.structure import Structure

STEEL_KG_PER_M3 = 7850.0
"""Structural steel, EN 1991-1-1 table A.4."""

_PLURALS = {"box": "boxes", "cylinder": "cylinders", "mesh": "meshes"}

app = typer.Typer(no_args_is_help=True)

OutArgument = Annotated[
    Path, typer.Argument(help="File to write; its suffix says the format. Replaced if it is there.")
]


class Kind(StrEnum):
    """What can be made."""

    ORTHOGONAL = "orthogonal"
    CROSSED = "crossed"
    TOWER = "tower"


@app.command()
def new(
    kind: Annotated[Kind, typer.Argument(help="What to make.")],
    out: Annotated[Path | None, typer.Argument(help="File to write, by its suffix; default KIND.yaml here.")] = None,
    spacing: Annotated[float, typer.Option(help="From node to node [m].")] = 2.0,
    width: Annotated[float, typer.Option(help="Of the square bars [m].")] = 0.15,
    bays: Annotated[str, typer.Option(help="Along x, y and z. [default: 2x2x3, tower 1x1x6]", metavar="AxBxC")] = "",
    yaw_deg: Annotated[float, typer.Option(help="Turns all of it about z.")] = 0.0,
    base_z: Annotated[float, typer.Option(help="Height of its underside over the ground at z = 0 [m].")] = 0.0,
    imperfection_mm: Annotated[float, typer.Option(help="Standard deviation of each node's place, as built.")] = 0.0,
    seed: Annotated[int, typer.Option(help="Of the imperfection.")] = 0,
    taper: Annotated[float | None, typer.Option(help="Tower: width at the top to that at the foot. [0.5]")] = None,
    bracing: Annotated[str | None, typer.Option(help="Tower: x or k. [x]")] = None,
) -> None:
    """Makes a lattice and writes it to a file."""
    from shared.world import generator
    from shared.world.files import save_structure

    is_tower = kind is Kind.TOWER
    if not is_tower and (taper is not None or bracing is not None):
        raise typer.BadParameter(f"--taper and --bracing are for towers, not for {kind}")
    try:
        lattice = generator.Lattice(
            spacing_m=spacing,
            width_m=width,
            bays=_bays(bays or ("1x1x6" if is_tower else "2x2x3")),
            yaw_deg=yaw_deg,
            base_z_m=base_z,
            imperfection_m=imperfection_mm / 1000,
            seed=seed,
        )
        if is_tower:
            structure = generator.tower(lattice, taper=0.5 if taper is None else taper, bracing=bracing or "x")
        else:
            make = generator.orthogonal_truss if kind is Kind.ORTHOGONAL else generator.crossed_truss
            structure = make(lattice)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    out = out or Path(f"{kind}.yaml")
    save_structure(structure, out)
    typer.echo(f"{summary_of(structure)}\n{out}")


@app.command()
def show(
    file: Annotated[Path, typer.Argument(help="YAML, SDF, URDF, STL, OBJ or PLY.")],
    out: Annotated[Path | None, typer.Option(help="Picture to write. [default: FILE's name with .png, here]")] = None,
) -> None:
    """Draws a structure as a picture and says what it is made of."""
    from cli.structure_pictures import draw_structure
    from shared.errors import InputFileError
    from shared.world.files import load_structure

    structure = load_structure(file)
    path = out or Path(f"{file.stem}.png")
    if path.suffix != ".png":
        raise typer.BadParameter(f"--out: pictures are .png files, not '{path.name}'")
    if not path.parent.is_dir():
        raise InputFileError(f"{path}: there is no folder {path.parent}")
    draw_structure(path, structure, summary_of(structure))
    typer.echo(f"{summary_of(structure)}\n{path}")


@app.command()
def convert(
    file: Annotated[Path, typer.Argument(help="YAML, SDF, URDF, STL, OBJ or PLY.")],
    out: OutArgument,
) -> None:
    """Writes a structure in another format: .yaml, .sdf, .world, .urdf or .stl."""
    from shared.world.files import load_structure, save_structure

    structure = load_structure(file)
    save_structure(structure, out)
    typer.echo(f"{summary_of(structure)}\n{out}")


def summary_of(structure: Structure) -> str:
    """Name, members by kind, extent and mass of the steel, a line each; where bars overlap they count twice."""
    from shared.world.mesh_format import world_mesh

    counts = Counter(type(member.solid).__name__.lower() for member in structure.members)
    kinds = ", ".join(f"{count} {_PLURALS[kind] if count > 1 else kind}" for kind, count in sorted(counts.items()))
    mesh = world_mesh(structure)
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    extent = "\n".join(f"{axis} {a:.3f} to {b:.3f} m" for axis, a, b in zip("xyz", low, high, strict=True))
    volumes = [_volume_m3(member.solid) for member in structure.members]
    num_open = sum(volume is None for volume in volumes)
    mass = f"steel {sum(v or 0.0 for v in volumes) * STEEL_KG_PER_M3:,.0f} kg at {STEEL_KG_PER_M3:,.0f} kg/m3"
    ground = "no ground" if structure.ground_z_m is None else f"ground at z = {structure.ground_z_m:g} m"
    left_out = f", without {num_open} open mesh{'es' if num_open > 1 else ''}" if num_open else ""
    return f"{structure.name}\nmembers: {kinds}\n{extent}\n{mass}{left_out}\n{ground}"


def _volume_m3(solid: Solid) -> float | None:
    """None where a mesh is not closed."""
    from shared.meshes import is_closed, volume_m3
    from shared.solids import Box, Cylinder, Mesh

    match solid:
        case Box(size_m):
            return math.prod(size_m)
        case Cylinder(radius_m, length_m):
            return math.pi * radius_m**2 * length_m
        case Mesh() as mesh if is_closed(mesh):
            return volume_m3(mesh)
    return None


def _bays(text: str) -> tuple[int, int, int]:
    try:
        x, y, z = (int(part) for part in text.split("x"))
    except ValueError:
        raise typer.BadParameter(f"--bays: needs three numbers like 2x2x3, got '{text}'") from None
    return x, y, z
