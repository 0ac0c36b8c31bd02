import math

import numpy as np
import pytest

from shared.errors import InputFileError
from shared.geometry import SE3
from shared.robot.description import Limits
from shared.robot.urdf import parse_urdf, read_urdf
from shared.runtime.config import CONFIGS_DIR
from shared.solids import Box, Cylinder, Sphere

ARM = """
<robot name="arm">
  <link name="base">
    <visual><geometry><box size="1 2 3"/></geometry></visual>
    <visual><origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/><geometry><sphere radius="0.5"/></geometry></visual>
  </link>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="arm"/>
    <origin xyz="1 0 0"/><axis xyz="0 0 2"/>
    <limit lower="-1" upper="2" velocity="3" effort="4"/>
  </joint>
  <link name="arm"/>
  <joint name="slide" type="prismatic">
    <parent link="arm"/><child link="hand"/>
    <axis xyz="0 -1 0"/>
    <limit lower="0" upper="0.5" velocity="0.1" effort="4"/>
  </joint>
  <link name="hand"><visual><geometry><cylinder radius="0.1" length="0.2"/></geometry></visual></link>
  <joint name="spin" type="continuous">
    <parent link="hand"/><child link="tool"/><limit velocity="5" effort="1"/>
  </joint>
  <link name="tool"/>
  <joint name="weld" type="fixed"><parent link="hand"/><child link="eye"/><origin xyz="0 0 0.1"/></joint>
  <link name="eye"/>
</robot>
"""


def test_an_arm_is_read_whole():
    model = parse_urdf(ARM, "arm.urdf")
    assert (model.name, model.root) == ("arm", "base")
    assert model.links == ("base", "arm", "hand", "tool", "eye")
    assert [(joint.parent, joint.child) for joint in model.joints] == [
        ("base", "arm"),
        ("arm", "hand"),
        ("hand", "tool"),
        ("hand", "eye"),
    ]
    assert model.limits == {
        "turn": Limits(-1.0, 2.0, 3.0, 4.0),
        "slide": Limits(0.0, 0.5, 0.1, 4.0),
        "spin": Limits(-math.inf, math.inf, 5.0, 1.0),
    }
    assert [(shape.link, shape.solid) for shape in model.shapes] == [
        ("base", Box((1.0, 2.0, 3.0))),
        ("base", Sphere(0.5)),
        ("hand", Cylinder(0.1, 0.2)),
    ]
    T = SE3.trans(z_m=1.0) @ SE3.rot("z", math.pi / 2)
    np.testing.assert_allclose(model.shapes[1].T_link_shape.matrix, T.matrix, atol=1e-15)


def test_joints_move_their_children():
    turn, slide, spin, weld = parse_urdf(ARM, "arm.urdf").joints
    assert turn.axis == (0.0, 0.0, 1.0)
    np.testing.assert_allclose(turn.T_parent_child(0.3).matrix, (SE3.trans(1) @ SE3.rot("z", 0.3)).matrix, atol=1e-15)
    np.testing.assert_allclose(slide.T_parent_child(0.3).matrix, SE3.trans(y_m=-0.3).matrix)
    np.testing.assert_allclose(spin.T_parent_child(0.3).matrix, SE3.rot("x", 0.3).matrix, atol=1e-15)
    np.testing.assert_allclose(weld.T_parent_child().matrix, SE3.trans(z_m=0.1).matrix)


def test_our_robot_has_the_limits_of_its_data_sheet():
    limits = parse_urdf(read_urdf(CONFIGS_DIR / "robot" / "hyrecro.urdf"), "hyrecro.urdf").limits
    half_turn, turn = Limits(-1.5708, 1.5708, 1.0, 50.0), Limits(-3.2, 3.2, 1.0, 50.0)
    stroke = Limits(-0.025, 0.025, 0.05, 500.0)
    assert list(limits) == [f"q{i}" for i in range(1, 9)]
    assert list(limits.values()) == [half_turn, stroke, half_turn, turn, turn, half_turn, stroke, half_turn]


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("</robot>", "", "no element found"),
        ("robot", "robots", "root element must be <robot>"),
        ('<robot name="arm">', '<!DOCTYPE robot><robot name="arm">', "document type declaration"),
        ('<link name="tool"/>', '<link name="arm"/>', "link 'arm': defined 2 times"),
        ('name="slide"', 'name="turn"', "joint 'turn': defined 2 times"),
        ('<link name="tool"/>', "<link/>", "link: attribute 'name' is missing"),
        ('<child link="tool"/>', '<child link="finger"/>', "joint 'spin': no link 'finger'; links are base, arm"),
        ('<child link="tool"/>', '<child link="hand"/>', "link 'hand': child of both 'slide' and 'spin'"),
        ('<child link="tool"/>', "", "joint 'spin': <child> is missing"),
        ('<link name="tool"/>', '<link name="tool"/><link name="other"/>', "one root link, there are 2: base, other"),
        ('<parent link="base"/>', '<parent link="eye"/>', "links in a cycle: arm, hand, tool, eye"),
        ('type="prismatic"', 'type="floating"', "joint 'slide': type 'floating' is not supported"),
        ('xyz="0 0 2"', 'xyz="0 0 0"', "joint 'turn': axis must not be zero"),
        ('xyz="0 0 2"', 'xyz="0 nan 1"', "joint 'turn': xyz: needs 3 finite numbers, got '0 nan 1'"),
        ('xyz="1 0 0"', 'xyz="1 0"', "joint 'turn': xyz: needs 3 finite numbers, got '1 0'"),
        ('lower="-1"', 'lower="3"', "joint 'turn': limit: lower 3 is above upper 2"),
        ('lower="-1"', "", "joint 'turn': limit: attribute 'lower' is missing"),
        ('velocity="3"', 'velocity="0"', "joint 'turn': limit: velocity must be positive, got 0"),
        ('velocity="3"', 'velocity="fast"', "limit: velocity: needs 1 finite number, got 'fast'"),
        ('<limit velocity="5" effort="1"/>', "", "joint 'spin': <limit> is missing"),
        ('size="1 2 3"', 'size="1 2 -3"', "link 'base': visual: box: size must be positive"),
        ('<sphere radius="0.5"/>', '<mesh filename="a.stl"/>', "mesh: 'a.stl': the path must be absolute here"),
        ('<sphere radius="0.5"/>', "", "must be one box, cylinder, sphere or mesh, is 0 elements"),
        ('length="0.2"', "", "link 'hand': visual: cylinder: attribute 'length' is missing"),
    ],
)
def test_what_cannot_be_used_is_named(old, new, reason):
    assert old in ARM
    with pytest.raises(InputFileError) as caught:
        parse_urdf(ARM.replace(old, new, 2 if old == "robot" else 1), "arm.urdf")
    assert str(caught.value).startswith("arm.urdf: ")
    assert reason in str(caught.value)


def test_links_that_only_hold_each_other_are_refused():
    ring = ARM.replace(
        '<link name="eye"/>',
        '<link name="eye"/><link name="p"/><link name="q"/>'
        '<joint name="pq" type="fixed"><parent link="p"/><child link="q"/></joint>'
        '<joint name="qp" type="fixed"><parent link="q"/><child link="p"/></joint>',
    )
    with pytest.raises(InputFileError, match="links in a cycle: p, q"):
        parse_urdf(ring, "arm.urdf")


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(InputFileError, match=r"missing\.urdf"):
        read_urdf(tmp_path / "missing.urdf")
    (tmp_path / "binary.urdf").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputFileError, match=r"binary\.urdf"):
        read_urdf(tmp_path / "binary.urdf")


def test_our_robot_has_masses_and_shapes_to_touch_with():
    model = parse_urdf(read_urdf(CONFIGS_DIR / "robot" / "hyrecro.urdf"), "hyrecro.urdf")
    assert set(model.inertias) == set(model.links)
    foot = model.inertias["foot_b"]
    np.testing.assert_allclose(foot.T_link_mass.translation, [0, 0, -0.025])
    assert (np.linalg.eigvalsh(foot.moments) > 0).all()
    assert {shape.link for shape in model.collisions} == set(model.links) - {"depth", "depth_optical"}


@pytest.mark.parametrize(
    ("inertial", "reason"),
    [
        ('<mass value="-1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>', "mass must not be negative"),
        ('<mass value="1"/><inertia ixx="1" ixy="2" ixz="0" iyy="1" iyz="0" izz="1"/>', "positive semi-definite"),
        ('<mass value="1"/>', "<inertia> is missing"),
    ],
)
def test_an_impossible_mass_is_refused(inertial, reason):
    with pytest.raises(InputFileError, match=f"link 'a': inertial: .*{reason}"):
        parse_urdf(f'<robot name="r"><link name="a"><inertial>{inertial}</inertial></link></robot>', "r.urdf")
