import numpy as np
import pytest

from shared.errors import ConfigError, InputFileError
from shared.geometry import SE3
from shared.solids import Box, Cylinder, Mesh
from shared.world.files import load_structure
from shared.world.structure import Member, Structure
from shared.world.yaml_format import structure_yaml

ALL = """
name: all
bars:
- {name: bar, centre_m: [0, 0, 2], size_m: [0.1, 0.1, 4]}
plates:
- {name: plate, centre_m: [0, 0, 4], size_m: [1, 1, 0.02], rpy_deg: [0, 0, 45]}
tubes:
- {name: tube, centre_m: [1, 0, 2], radius_m: 0.05, length_m: 3}
meshes:
- {name: gusset, file: parts/t.ply, scale: 0.001, centre_m: [0, 0, 1]}
- {name: foot, file: parts/t.ply}
"""


def written(tmp_path, text):
    path = tmp_path / "structure.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_kind_of_part_is_read(tmp_path, write_tetrahedron):
    (tmp_path / "parts").mkdir()
    write_tetrahedron(tmp_path / "parts" / "t.ply")
    bar, plate, tube, gusset, foot = load_structure(written(tmp_path, ALL)).members
    assert (bar.solid, plate.solid, tube.solid) == (Box((0.1, 0.1, 4.0)), Box((1.0, 1.0, 0.02)), Cylinder(0.05, 3.0))
    assert isinstance(gusset.solid, Mesh)
    assert isinstance(foot.solid, Mesh)
    assert (gusset.solid.file, gusset.solid.scale) == (tmp_path / "parts" / "t.ply", (0.001, 0.001, 0.001))
    np.testing.assert_allclose(gusset.solid.vertices_m.max(axis=0), [0.001, 0.001, 0.001])
    np.testing.assert_array_equal(gusset.T_world_member.translation, [0, 0, 1])
    np.testing.assert_array_equal(foot.T_world_member.matrix, np.eye(4))


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("radius_m: 0.05", "radius_m: 0", "tubes[0].radius_m: should be greater than 0, got 0"),
        ("name: plate", "name: bar", "bar 'bar': defined 2 times"),
        (
            "centre_m: [1, 0, 2]",
            "centre_m: [1, 0, 2e6]",
            "tubes[0].centre_m[2]: should be less than or equal to 1000000",
        ),
        ("size_m: [1, 1, 0.02]", "size_m: [1, 1, 4000]", "plates[0].size_m[2]: should be less than or equal to 1000"),
        ("scale: 0.001", "scale: -1", "meshes[0].scale"),
        ("name: all", "name: all\nground_z_m: .nan", "ground_z_m: should be a finite number"),
        ("plates:", "panels:", "panels: unknown key"),
    ],
)
def test_problems_are_named(tmp_path, old, new, reason, write_tetrahedron):
    (tmp_path / "parts").mkdir()
    write_tetrahedron(tmp_path / "parts" / "t.ply")
    assert old in ALL
    path = written(tmp_path, ALL.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        load_structure(path)
    assert f"{path}: {reason}" in str(caught.value)


def test_a_mesh_that_cannot_be_read_is_named_with_its_member(tmp_path):
    with pytest.raises(InputFileError, match=r"structure\.yaml: mesh 'gusset': .*parts/t\.ply: No such file"):
        load_structure(written(tmp_path, ALL))


def test_a_file_that_is_nested_without_end_is_refused(tmp_path):
    with pytest.raises(InputFileError, match=r"structure\.yaml: not valid YAML: lists or maps are nested too deeply"):
        load_structure(written(tmp_path, "[" * 5000))


def test_no_parts_are_no_structure(tmp_path):
    with pytest.raises(ConfigError, match=r"structure\.yaml: there is no box, cylinder or mesh in it"):
        load_structure(written(tmp_path, "name: s\n"))


def test_what_is_written_can_be_read_by_people():
    members = (
        Member("bar", Box((0.1, 0.1, 4.0)), SE3.trans(-1.9, 0.0, 2.0)),
        Member("plate", Box((1.0, 1.0, 0.02)), SE3.from_rpy([0.0, 0.0, np.pi / 2])),
        Member("tube", Cylinder(0.05, 3.0), SE3.identity()),
    )
    assert structure_yaml(Structure("some", members, 0.0)) == (
        'name: "some"\n'
        "ground_z_m: 0.0\n"
        "bars:\n"
        '  - {name: "bar", centre_m: [-1.9, 0.0, 2.0], size_m: [0.1, 0.1, 4.0]}\n'
        "plates:\n"
        '  - {name: "plate", centre_m: [0.0, 0.0, 0.0], size_m: [1.0, 1.0, 0.02], rpy_deg: [0.0, 0.0, 90.0]}\n'
        "tubes:\n"
        '  - {name: "tube", centre_m: [0.0, 0.0, 0.0], radius_m: 0.05, length_m: 3.0}\n'
    )
