"""Reads triangle meshes of STL, OBJ and PLY files."""

from __future__ import annotations

import logging
from io import BytesIO
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from shared.errors import InputFileError
from shared.files import BYTES_A_MIB, read_bytes
from shared.meshes import area_m2, is_closed, volume_m3
from shared.solids import Mesh, Vector3

MESH_SUFFIXES = (".stl", ".obj", ".ply")
MAX_FILE_BYTES = 256 * BYTES_A_MIB
MAX_VERTICES = 2_000_000
MAX_COORDINATE_M = 1e6
"""Also far beyond any structure: what lies farther is a wrong unit or a broken file."""


def read_mesh(path: Path, scale: Vector3 = (1.0, 1.0, 1.0)) -> Mesh:
    """The mesh of a file in metres: its coordinates times `scale`. The mesh may be open.

    Vertices at the same place become one, triangles that collapse by that go. A closed mesh that is wound inside out is
    turned.

    Raises:
        InputFileError: the file cannot be read, is no mesh, is too large, or its shape is empty or not finite.
    """
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise InputFileError(f"{path}: meshes are read from {', '.join(MESH_SUFFIXES)}, not from '{suffix}'")
    if not min(scale) > 0 or not np.isfinite(scale).all():
        raise InputFileError(f"{path}: scale must be positive and finite, got {scale}")
    mesh = _checked(_parsed(path, read_bytes(path, MAX_FILE_BYTES), scale), path)
    if is_closed(mesh) and volume_m3(mesh) < 0:
        return Mesh(mesh.vertices_m, np.ascontiguousarray(mesh.triangles[:, ::-1]), mesh.file, mesh.scale)
    return mesh


def mesh_path(uri: str, folder: Path | None) -> Path:
    """Where the file of a mesh is: file:// or a plain path, a relative one below `folder`.

    Raises:
        ValueError: another kind of address, or a relative path without a folder.
    """
    scheme, separator, rest = uri.partition("://")
    if separator and scheme != "file":
        raise ValueError(f"'{uri}': only file:// and plain paths are read, not {scheme}://")
    path = Path(unquote(rest) if separator else uri)
    if not path.is_absolute():
        if folder is None:
            raise ValueError(f"'{uri}': the path must be absolute here")
        path = folder / path
    return path.resolve()


def mesh_uri(mesh: Mesh) -> str:
    """The file:// address of a mesh that was read from a file.

    Raises:
        ValueError: it was made in memory, so no document can refer to it.
    """
    if mesh.file is None:
        raise ValueError("a mesh without a file cannot be referred to; write it to an STL file and load that")
    return mesh.file.resolve().as_uri()


def _parsed(path: Path, content: bytes, scale: Vector3) -> Mesh:
    import trimesh  # half a second: only for those who read meshes

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # it logs a traceback before it raises what we report
    kind = path.suffix[1:].lower()
    try:  # bytes, not a path: materials and textures beside it are not opened
        read = trimesh.load_mesh(BytesIO(content), file_type=kind, process=False, skip_materials=True)
        if not np.isfinite(read.vertices).all():
            raise ValueError("a coordinate is not finite")
        if read.vertices.shape[1:] != (3,):
            raise ValueError("a vertex needs three coordinates")
        read.merge_vertices(merge_tex=True, merge_norm=True)
        vertices, triangles = np.asarray(read.vertices, dtype=np.float64), np.asarray(read.faces)
    except Exception as error:  # the reader raises whatever broken bytes lead it to
        raise InputFileError(f"{path}: not a usable {kind.upper()} mesh: {error}") from error
    if len(triangles) == 0:
        raise InputFileError(f"{path}: not a usable {kind.upper()} mesh: it has no triangles")
    if len(vertices) > MAX_VERTICES:
        raise InputFileError(f"{path}: {len(vertices)} vertices, at most {MAX_VERTICES} are read")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise InputFileError(f"{path}: a triangle refers to a vertex that is not there")
    is_flat = (triangles == np.roll(triangles, 1, axis=1)).any(axis=1)
    return Mesh(vertices * np.array(scale), triangles[~is_flat].astype(np.uint32), path.resolve(), scale)


def _checked(mesh: Mesh, path: Path) -> Mesh:
    if (reach_m := float(np.abs(mesh.vertices_m).max())) > MAX_COORDINATE_M:
        raise InputFileError(f"{path}: a coordinate is {reach_m:g} m, at most {MAX_COORDINATE_M:g} m is read")
    if area_m2(mesh) <= 0:
        raise InputFileError(f"{path}: the mesh is degenerate: its triangles have no area")
    return mesh
