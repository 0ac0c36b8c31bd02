"""Every format: what is written is what is read."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from shared.errors import ConfigError, InputFileError
from shared.geometry import SE3
from shared.mesh_files import read_mesh
from shared.meshes import mesh_of, volume_m3
from shared.solids import Box, Cylinder, Mesh
from shared.world.files import READERS, WRITERS, load_structure, save_structure
from shared.world.structure import Member, Structure, unique_names

angles = st.one_of(st.floats(-np.pi, np.pi), st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi]))
poses = st.builds(SE3.from_rpy, st.tuples(angles, angles, angles), st.tuples(*[st.floats(-100, 100)] * 3))
lengths = st.floats(1e-3, 100)
solids = st.one_of(st.builds(Box, st.tuples(lengths, lengths, lengths)), st.builds(Cylinder, lengths, lengths))
members = st.lists(st.tuples(solids, poses), min_size=1, max_size=5).map(
    lambda parts: tuple(Member(f"m_{i}", solid, T) for i, (solid, T) in enumerate(parts))
)
structures = st.builds(Structure, st.just("s"), members, st.none() | st.floats(-100, 100))

EXACT = sorted(set(WRITERS) - {".stl"})


@pytest.mark.parametrize("suffix", EXACT)
@settings(max_examples=30)
@given(structures)
def test_what_is_written_is_read_again(suffix, structure):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"structure{suffix}"
        save_structure(structure, path)
        read = load_structure(path)
    assert read.name == structure.name
    if structure.ground_z_m is None:
        assert read.ground_z_m is None
    else:
        assert read.ground_z_m == pytest.approx(structure.ground_z_m, abs=1e-12)
    before, after = ({member.name: member for member in some.members} for some in (structure, read))
    assert set(before) == set(after)
    for name, member in before.items():
        assert after[name].solid == member.solid
        np.testing.assert_allclose(after[name].T_world_member.matrix, member.T_world_member.matrix, rtol=0, atol=1e-12)


@pytest.mark.parametrize("suffix", EXACT)
def test_a_mesh_goes_through_every_format_by_its_file(tmp_path, suffix, write_tetrahedron):
    write_tetrahedron(tmp_path / "t.ply")
    part = Member("part", read_mesh(tmp_path / "t.ply", (2.0, 3.0, 4.0)), SE3.trans(z_m=5.0))
    (tmp_path / "elsewhere").mkdir()
    path = tmp_path / "elsewhere" / f"structure{suffix}"
    save_structure(Structure("s", (part,), None), path)
    (read,) = load_structure(path).members
    assert isinstance(read.solid, Mesh)
    assert (read.name, read.solid.file, read.solid.scale) == ("part", tmp_path / "t.ply", (2.0, 3.0, 4.0))
    np.testing.assert_array_equal(read.solid.vertices_m, part.solid.vertices_m)
    np.testing.assert_array_equal(read.T_world_member.translation, [0, 0, 5])


def test_an_stl_has_the_same_volume(tmp_path):
    T = SE3.from_rpy([0.1, 0.2, 0.3], [5.0, 6.0, 7.0])
    parts = (
        Member("b", Box((0.2, 0.3, 4.0)), T),
        Member("c", Cylinder(0.1, 2.0), SE3.identity()),
        Member("m", mesh_of(Box((1.0, 1.0, 1.0))), T @ SE3.trans(3.0)),
    )
    save_structure(Structure("s", parts, 0.0), tmp_path / "s.stl")
    read = load_structure(tmp_path / "s.stl")
    (whole,) = read.members
    assert isinstance(whole.solid, Mesh)
    expected_m3 = sum(volume_m3(mesh_of(part.solid)) for part in parts)
    assert volume_m3(whole.solid) == pytest.approx(expected_m3, rel=1e-5)
    corner = parts[0].T_world_member.apply(np.array([0.1, 0.15, 2.0]))
    assert np.linalg.norm(whole.solid.vertices_m - corner, axis=1).min() < 1e-6
    assert (read.name, whole.name, read.ground_z_m) == ("s", "s", None)


@pytest.mark.parametrize("suffix", EXACT)
def test_a_mesh_without_a_file_is_refused(tmp_path, suffix):
    part = Member("p", mesh_of(Box((1.0, 1.0, 1.0))), SE3.identity())
    with pytest.raises(InputFileError, match="member 'p': a mesh without a file cannot be referred to"):
        save_structure(Structure("s", (part,), None), tmp_path / f"s{suffix}")
    assert list(tmp_path.iterdir()) == []


def test_unknown_suffixes_name_those_that_are_known(tmp_path):
    bar = Member("b", Box((1.0, 1.0, 1.0)), SE3.identity())
    with pytest.raises(InputFileError, match=r"a\.dae: structures are read from .*\.ply, not from '\.dae'"):
        load_structure(tmp_path / "a.dae")
    with pytest.raises(InputFileError, match=r"a\.ply: structures are written as .*\.stl, not as '\.ply'"):
        save_structure(Structure("s", (bar,), None), tmp_path / "a.ply")
    with pytest.raises(InputFileError, match=r"absent/a\.yaml: No such file"):
        save_structure(Structure("s", (bar,), None), tmp_path / "absent" / "a.yaml")


@pytest.mark.parametrize("suffix", READERS)
def test_each_reader_names_a_missing_file(tmp_path, suffix):
    with pytest.raises(InputFileError, match=rf"absent\{suffix}: No such file"):
        load_structure(tmp_path / f"absent{suffix}")


@pytest.mark.parametrize("suffix", READERS)
def test_each_reader_refuses_bytes_that_are_none_of_its(tmp_path, suffix):
    path = tmp_path / f"noise{suffix}"
    path.write_bytes(np.random.default_rng(1).bytes(500))
    with pytest.raises((InputFileError, ConfigError), match=rf"noise\{suffix}: "):
        load_structure(path)


def test_names_are_made_fit_and_unique():
    assert unique_names(["a b", "a_b", "a b", "/x/", "*", "ok.1-2"]) == [
        "a_b",
        "a_b_2",
        "a_b_3",
        "x",
        "member",
        "ok.1-2",
    ]
