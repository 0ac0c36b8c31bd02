from pathlib import Path

import numpy as np
import pytest

from shared import mesh_files
from shared.errors import InputFileError
from shared.mesh_files import mesh_path, mesh_uri, read_mesh
from shared.meshes import is_closed, mesh_of, volume_m3
from shared.solids import Box

FACETS = [  # of a tetrahedron with its right angle at the origin, seen from outside
    ("0 0 0", "0 1 0", "1 0 0"),
    ("0 0 0", "1 0 0", "0 0 1"),
    ("0 0 0", "0 0 1", "0 1 0"),
    ("1 0 0", "0 1 0", "0 0 1"),
]


def stl(facets) -> str:
    loops = "".join(
        f"facet normal 0 0 0\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nendloop\nendfacet\n" for a, b, c in facets
    )
    return f"solid s\n{loops}endsolid s\n"


OBJ = """mtllib absent.mtl
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
usemtl steel
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


def test_each_format_gives_the_same_closed_mesh(tmp_path, write_tetrahedron):
    paths = [tmp_path / f"t.{suffix}" for suffix in ("stl", "obj", "PLY")]
    paths[0].write_text(stl(FACETS))
    paths[1].write_text(OBJ)
    write_tetrahedron(paths[2])
    for path in paths:
        mesh = read_mesh(path)
        assert (mesh.file, mesh.scale) == (path, (1.0, 1.0, 1.0))
        assert (mesh.vertices_m.shape, mesh.triangles.shape, mesh.triangles.dtype) == ((4, 3), (4, 3), np.uint32)
        assert is_closed(mesh)
        assert volume_m3(mesh) == pytest.approx(1 / 6)


def test_the_scale_makes_metres(tmp_path, write_tetrahedron):
    write_tetrahedron(tmp_path / "t.ply")
    mesh = read_mesh(tmp_path / "t.ply", (0.001, 0.002, 0.003))
    np.testing.assert_allclose(mesh.vertices_m.max(axis=0), [0.001, 0.002, 0.003])
    assert mesh.scale == (0.001, 0.002, 0.003)


def test_a_closed_mesh_that_is_inside_out_is_turned_and_an_open_one_taken(tmp_path):
    (tmp_path / "t.stl").write_text(stl([facet[::-1] for facet in FACETS]))
    assert volume_m3(read_mesh(tmp_path / "t.stl")) == pytest.approx(1 / 6)
    (tmp_path / "t.stl").write_text(stl(FACETS[:3]))
    assert not is_closed(read_mesh(tmp_path / "t.stl"))


def test_triangles_without_extent_go(tmp_path):
    (tmp_path / "t.stl").write_text(stl([*FACETS, ("0 0 0", "0 0 0", "1 0 0")]))
    mesh = read_mesh(tmp_path / "t.stl")
    assert len(mesh.triangles) == 4
    assert is_closed(mesh)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("t.dae", "", "meshes are read from .stl, .obj, .ply, not from '.dae'"),
        ("t.stl", "", "not a usable STL mesh: "),
        ("t.stl", "solid s\nendsolid s\n", "not a usable STL mesh: "),
        ("t.stl", "x" * 200, "not a usable STL mesh: "),
        ("t.stl", stl([("0 0 0", "0 nan 0", "1 0 0")]), "a coordinate is not finite"),
        ("t.stl", stl([("0 0 0", "0 2e6 0", "1 0 0")]), "a coordinate is 2e+06 m, at most 1e+06 m is read"),
        ("t.stl", stl([("0 0 0", "0 1 0", "0 2 0")]), "the mesh is degenerate"),
        ("t.stl", stl([("0 0 0", "0 0 0", "0 2 0")]), "the mesh is degenerate"),
        ("t.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "not a usable OBJ mesh: "),
        ("t.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "t.obj: "),
        ("t.obj", "v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "a vertex needs three coordinates"),
        ("t.obj", "v 0 0 zero\nf 1 1 1\n", "not a usable OBJ mesh: "),
        ("t.ply", "ply\nformat ascii 1.0\nelement vertex 9\n", "not a usable PLY mesh: "),
    ],
)
def test_what_is_no_mesh_is_refused(tmp_path, name, content, reason):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputFileError) as caught:
        read_mesh(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert reason in str(caught.value)


@pytest.mark.parametrize("scale", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, float("nan")), (1e400, 1.0, 1.0)])
def test_a_scale_that_is_none_is_refused(tmp_path, scale):
    with pytest.raises(InputFileError, match=r"t\.stl: scale must be positive and finite"):
        read_mesh(tmp_path / "t.stl", scale)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputFileError, match=r"absent\.stl: No such file"):
        read_mesh(tmp_path / "absent.stl")


def test_files_beyond_limits_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "t.stl"
    path.write_text(stl(FACETS))
    monkeypatch.setattr(mesh_files, "MAX_VERTICES", 3)
    with pytest.raises(InputFileError, match="4 vertices, at most 3 are read"):
        read_mesh(path)
    monkeypatch.setattr(mesh_files, "MAX_FILE_BYTES", 100)
    with pytest.raises(InputFileError, match=r"at most .* are read"):
        read_mesh(path)


def test_paths_of_meshes():
    folder = Path("/models/crane")
    assert mesh_path("meshes/a.stl", folder) == Path("/models/crane/meshes/a.stl")
    assert mesh_path("../a.stl", folder) == Path("/models/a.stl")
    assert mesh_path("/a.stl", None) == mesh_path("file:///a.stl", None) == Path("/a.stl")
    assert mesh_path("file:///a%20b.stl", None) == Path("/a b.stl")
    with pytest.raises(ValueError, match=r"'package://crane/a\.stl': only file:// and plain paths are read"):
        mesh_path("package://crane/a.stl", folder)
    with pytest.raises(ValueError, match=r"'a\.stl': the path must be absolute here"):
        mesh_path("a.stl", None)


def test_a_mesh_says_where_it_is_from(tmp_path, write_tetrahedron):
    write_tetrahedron(tmp_path / "a b.ply")
    mesh = read_mesh(tmp_path / "a b.ply")
    assert mesh_path(mesh_uri(mesh), None) == tmp_path / "a b.ply"
    with pytest.raises(ValueError, match="a mesh without a file cannot be referred to"):
        mesh_uri(mesh_of(Box((1.0, 1.0, 1.0))))
