"""Structures in files: the suffix says the format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from shared.errors import ConfigError, InputFileError
from shared.mesh_files import MESH_SUFFIXES
from shared.world.mesh_format import read_mesh_structure, structure_stl
from shared.world.sdf_format import read_sdf_structure
from shared.world.sdf_writing import structure_sdf
from shared.world.structure import Structure, problems_of
from shared.world.urdf_format import read_urdf_structure, structure_urdf
from shared.world.yaml_format import read_yaml_structure, structure_yaml

READERS: dict[str, Callable[[Path], Structure]] = {
    ".yaml": read_yaml_structure,
    ".yml": read_yaml_structure,
    ".sdf": read_sdf_structure,
    ".world": read_sdf_structure,
    ".urdf": read_urdf_structure,
    **dict.fromkeys(MESH_SUFFIXES, read_mesh_structure),
}
WRITERS: dict[str, Callable[[Structure], str | bytes]] = {
    ".yaml": structure_yaml,
    ".yml": structure_yaml,
    ".sdf": structure_sdf,
    ".world": structure_sdf,
    ".urdf": structure_urdf,
    ".stl": structure_stl,
}


def load_structure(path: Path) -> Structure:
    """The structure of a file of any format in `READERS`.

    Raises:
        InputFileError: the file cannot be read, is not of its format, or its suffix is unknown.
        ConfigError: with one line for each problem: file, element, reason.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputFileError(f"{path}: structures are read from {', '.join(READERS)}, not from '{path.suffix}'")
    structure = reader(path)
    if problems := problems_of(structure):
        raise ConfigError([f"{path}: {problem}" for problem in problems])
    return structure


def save_structure(structure: Structure, path: Path) -> None:
    """Writes the structure as a file of any format in `WRITERS`; one that is there is replaced.

    Raises:
        InputFileError: the file cannot be written, its suffix is unknown, or its format cannot hold a member.
    """
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputFileError(f"{path}: structures are written as {', '.join(WRITERS)}, not as '{path.suffix}'")
    try:
        content = writer(structure)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror or error}") from error
