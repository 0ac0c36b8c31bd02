"""Structures as one triangle mesh: read from STL, OBJ or PLY, written as STL."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from shared.geometry import SE3
from shared.mesh_files import read_mesh
from shared.meshes import merged, mesh_of
from shared.solids import Mesh
from shared.world.structure import Member, Structure, unique_names

_HEADER = b"binary STL, metres, world frame".ljust(80)
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""As the format has it: 50 bytes a triangle."""


def read_mesh_structure(path: Path) -> Structure:
    """The structure of one member that a mesh file in metres and in the world frame is.

    Raises:
        InputFileError: naming file and reason.
    """
    (name,) = unique_names([path.stem])
    return Structure(name, (Member(name, read_mesh(path), SE3.identity()),), None)


def world_mesh(structure: Structure) -> Mesh:
    """All members as one mesh in the world frame."""
    return merged([mesh_of(member.solid).moved(member.T_world_member) for member in structure.members])


def structure_stl(structure: Structure) -> bytes:
    """All members, without the ground, as a binary STL file: float32 metres in the world frame."""
    mesh = world_mesh(structure)
    corners = mesh.vertices_m[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(corners), dtype=_TRIANGLE)
    records["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    records["corners"] = corners
    return _HEADER + np.uint32(len(records)).tobytes() + records.tobytes()
