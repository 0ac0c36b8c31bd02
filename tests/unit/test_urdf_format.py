import numpy as np
import pytest

from shared.errors import ConfigError, InputFileError
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.robot.urdf import parse_urdf
from shared.solids import Box, Cylinder, Mesh
from shared.world.files import load_structure
from shared.world.structure import Member, Structure
from shared.world.urdf_format import structure_urdf

CRANE = """
<robot name="crane 1">
  <link name="tip"><collision name="hook"><geometry><cylinder radius="0.1" length="0.2"/></geometry></collision></link>
  <link name="mast">
    <visual><geometry><box size="9 9 9"/></geometry></visual>
    <collision><origin xyz="0 0 2"/><geometry><box size="0.2 0.2 4"/></geometry></collision>
  </link>
  <link name="arm"><visual><geometry><box size="3 0.1 0.1"/></geometry></visual></link>
  <joint name="turn" type="revolute">
    <parent link="mast"/><child link="arm"/><origin xyz="0 0 4" rpy="0 0 1.5707963267948966"/>
    <limit lower="1" upper="2" velocity="1"/>
  </joint>
  <joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="3 0 0"/></joint>
</robot>
"""


def loaded(tmp_path, text):
    path = tmp_path / "some.urdf"
    path.write_text(text, encoding="utf-8")
    return load_structure(path)


def test_links_become_members_where_their_joints_at_zero_put_them(tmp_path):
    structure = loaded(tmp_path, CRANE)
    members = {member.name: member for member in structure.members}
    assert (structure.name, structure.ground_z_m) == ("crane_1", None)
    assert {name: member.solid for name, member in members.items()} == {
        "hook": Cylinder(0.1, 0.2),
        "mast": Box((0.2, 0.2, 4.0)),
        "arm": Box((3.0, 0.1, 0.1)),
    }
    np.testing.assert_allclose(members["mast"].T_world_member.translation, [0, 0, 2])
    np.testing.assert_allclose(members["arm"].T_world_member.rotation[:, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(members["hook"].T_world_member.translation, [0, 3, 4], atol=1e-15)


def test_the_ground_comes_back_as_ground(tmp_path):
    bar = Member("b", Box((2.0, 3.0, 6.0)), SE3.trans(x_m=10.0))
    structure = loaded(tmp_path, structure_urdf(Structure("s", (bar,), ground_z_m=-1.5)))
    assert [member.name for member in structure.members] == ["b"]
    assert structure.ground_z_m == pytest.approx(-1.5, abs=1e-12)


def test_meshes_are_written_by_their_file_and_read_from_it(tmp_path, write_tetrahedron):
    write_tetrahedron(tmp_path / "a b.ply")
    text = (
        '<robot name="r"><link name="l"><visual><geometry><mesh filename="a b.ply" scale="2 2 2"/></geometry></visual>'
    )
    (part,) = loaded(tmp_path, text + "</link></robot>").members
    assert isinstance(part.solid, Mesh)
    document = structure_urdf(Structure("s", (part,), None))
    assert f'filename="file://{tmp_path}/a%20b.ply" scale="2.0 2.0 2.0"' in document
    (shape,) = parse_urdf(document, "channel").shapes
    np.testing.assert_array_equal(shape.solid.vertices_m, part.solid.vertices_m)
    np.testing.assert_array_equal(shape.solid.triangles, part.solid.triangles)


def test_a_mesh_without_a_file_cannot_be_written():
    part = Member("p", mesh_of(Box((1.0, 1.0, 1.0))), SE3.identity())
    with pytest.raises(ValueError, match="member 'p': a mesh without a file cannot be referred to"):
        structure_urdf(Structure("s", (part,), None))


@pytest.mark.parametrize(
    ("geometry", "reason"),
    [
        ('<sphere radius="1"/>', "link 'l': a structure is of boxes, cylinders and meshes, not spheres"),
        ('<mesh filename="package://p/a.stl"/>', "link 'l': visual: mesh: 'package://p/a.stl': only file:// and plain"),
        ('<mesh filename="a.stl"/>', "a.stl: No such file"),
        ('<mesh filename="a.stl" scale="1 1 0"/>', "scale must be positive and finite"),
        ("<mesh/>", "link 'l': visual: mesh: attribute 'filename' is missing"),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path, geometry, reason):
    text = f'<robot name="r"><link name="l"><visual><geometry>{geometry}</geometry></visual></link></robot>'
    with pytest.raises(InputFileError) as caught:
        loaded(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'some.urdf'}: ")
    assert reason in str(caught.value)


def test_a_robot_of_nothing_is_no_structure(tmp_path):
    with pytest.raises(ConfigError, match=r"some\.urdf: there is no box, cylinder or mesh in it"):
        loaded(tmp_path, '<robot name="r"><link name="l"/></robot>')
