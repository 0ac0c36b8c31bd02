import numpy as np
import pytest

from services.sensors.surroundings import Schedule, Surroundings
from shared.errors import InputFileError, MessageError
from shared.geometry import SE3
from shared.messaging.messages import RobotDescription, StructureDescription, Transforms

ROBOT = """<robot name="r">
  <link name="body"><visual><geometry><box size="0.4 0.4 0.4"/></geometry></visual></link>
  <link name="eye"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>
  <joint name="mount" type="fixed"><parent link="body"/><child link="eye"/></joint>
</robot>"""
STRUCTURE = """<robot name="s"><link name="root">
  <visual name="bar"><geometry><box size="8 6 4"/></geometry></visual>
  <visual name="post"><geometry><box size="1 1 1"/></geometry></visual>
</link></robot>"""


def describe(surroundings, robot=ROBOT, structure=STRUCTURE):
    surroundings.set_structure(StructureDescription(stamp_ns=0, seq=0, frame="world", urdf=structure))
    surroundings.set_robot(RobotDescription(stamp_ns=0, seq=0, frame="body", urdf=robot))
    return surroundings


def around(sees_robot=True, **given):
    return Surroundings("eye", sees_robot=sees_robot, sensor_name="camera", **given)


def transforms(stamp_ns, x_m):
    poses = [SE3.trans(x_m=x_m).xyz_quat_xyzw, SE3.trans(z_m=1.0).xyz_quat_xyzw]
    return Transforms(
        stamp_ns=stamp_ns,
        seq=0,
        frame="world",
        parents=("world", "body"),
        children=("body", "eye"),
        T_parent_child=np.array(poses),
    )


def test_the_structures_shapes_come_first_then_the_robots():
    surroundings = describe(around())
    assert surroundings.scene.names == ("bar", "post", "body", "eye")
    assert surroundings.scene.links == ("world", "body", "eye")
    assert surroundings.own_shapes == slice(2, 4)


def test_a_sensor_that_does_not_see_the_robot_has_the_structure_alone():
    assert describe(around(sees_robot=False)).scene.names == ("bar", "post")


def test_whoever_asks_is_told_each_scene():
    scenes = []
    surroundings = around(on_scene=scenes.append)
    assert surroundings.scene is None
    describe(surroundings)
    assert scenes == [surroundings.scene]
    describe(surroundings)
    assert len(scenes) == 3


def test_poses_of_a_still_sensor():
    poses = describe(around()).poses([transforms(50, 2.0)], [50])
    np.testing.assert_allclose(poses.sensor_translation_m, [[2.0, 0.0, 1.0]])
    np.testing.assert_allclose(poses.link_translation_m, [[[0, 0, 0], [2.0, 0, 0], [2.0, 0, 1.0]]])
    assert poses.sensor_rotation.shape == (1, 3, 3)
    assert poses.link_rotation.shape == (1, 3, 3, 3)


def test_the_sensor_moves_with_each_column_and_the_links_with_each_block():
    stamps_ns = np.arange(0, 80, 10)
    poses = describe(around()).poses([transforms(0, 0.0), transforms(80, 8.0)], stamps_ns, num_blocks=2)
    np.testing.assert_allclose(poses.sensor_translation_m[:, 0], np.arange(8.0))
    np.testing.assert_allclose(poses.link_translation_m[:, 1, 0], [1.5, 5.5])  # of columns 0 to 3 and 4 to 7


def test_what_does_not_fit_is_refused():
    with pytest.raises(InputFileError, match="no link 'eye' for the camera; links are body"):
        describe(around(), robot='<robot name="r"><link name="body"/></robot>')
    with pytest.raises(InputFileError, match="must be one link, is body, eye"):
        describe(around(), structure=ROBOT)
    with pytest.raises(MessageError, match="the camera needs the descriptions"):
        around().poses([transforms(0, 0.0)], [0])
    unconnected = Transforms(stamp_ns=0, seq=0, frame="world", parents=(), children=(), T_parent_child=np.empty((0, 7)))
    with pytest.raises(MessageError, match="no path from 'world' to frame 'eye'"):
        describe(around()).poses([unconnected], [0])


def test_a_scene_without_shapes_has_poses_too():
    empty = '<robot name="s"><link name="root"/></robot>'
    surroundings = describe(around(sees_robot=False), structure=empty)
    assert surroundings.scene.num_faces == 0
    assert surroundings.poses([transforms(0, 1.0)], [0]).sensor_translation_m.tolist() == [[1.0, 0.0, 1.0]]


def test_the_first_stamp_of_each_period_is_due():
    schedule = Schedule(10.0)
    due_ms = [t for t in (0, 50, 99, 130, 140, 210, 450, 460, 0, 90, 100) if schedule.is_due(t * 1_000_000)]
    assert due_ms == [0, 130, 210, 450, 0, 100]
