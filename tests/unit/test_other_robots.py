"""Another robot in view of the sensors: where its points lie, what the truth calls them, what is refused."""

import numpy as np
import pytest

from services.sensors.depth.camera import DepthCamera
from services.sensors.other_robots import OtherRobots
from services.sensors.surroundings import MEMBERS_A_ROBOT
from shared.errors import ConfigError, InputFileError, MessageError
from shared.geometry import SE3
from shared.messaging.messages import RobotDescription, Transforms
from shared.runtime.config_loading import load_config
from shared.runtime.sensor_config import DepthConfig
from tests.support.sensing import beams, lidar_config, robot, scanner, structure, transforms

BALL = """<robot name="ball">
  <link name="base"/>
  <link name="ball"><visual><geometry><sphere radius="0.3"/></geometry></visual></link>
  <joint name="arm" type="fixed"><parent link="base"/><child link="ball"/></joint>
</robot>"""


@pytest.fixture(params=["scan_conversion", "embree"])
def backend(request):
    return request.param


def ball(urdf=BALL):
    return RobotDescription(stamp_ns=0, seq=0, frame="base", urdf=urdf)


def at(x_m, y_m=0.0, *, stamp_ns=0, root="world", children=("base", "ball")):
    """The ball's centre there; its clock is its own."""
    poses = [SE3.trans(x_m, y_m).xyz_quat_xyzw, SE3.identity().xyz_quat_xyzw]
    return Transforms(
        stamp_ns=stamp_ns, seq=0, frame=root, parents=(root, "base"), children=children, T_parent_child=np.array(poses)
    )


def on_ball(scan, x_m, y_m=0.0):
    return np.abs(np.linalg.norm(scan.points_m - [x_m, y_m, 0.0], axis=1) - 0.3) < 0.02


def looking(names=("robot_b",), **changes):
    return scanner(lidar_config(truth=True, **changes), beams(256, 32), other_robots=names)


def test_a_robot_in_view_has_points_and_the_truth_names_it(backend):
    lidar = looking(backend=backend)
    (without,) = lidar.add_transforms(transforms(0))
    assert not on_ball(without, 2.0).any()
    lidar.set_other("robot_b", ball())
    lidar.place_other("robot_b", at(2.0, stamp_ns=77_000_000_000))
    (scan,) = lidar.add_transforms(transforms(100))
    assert on_ball(scan, 2.0).sum() > 10
    assert set(scan.member[on_ball(scan, 2.0)].tolist()) == {MEMBERS_A_ROBOT}
    assert set(scan.member[~on_ball(scan, 2.0)].tolist()) == {0}


def test_it_is_seen_where_it_last_said_to_be():
    lidar = looking()
    lidar.set_other("robot_b", ball())
    for time_ms, x_m in ((0, 2.0), (100, -2.5)):
        lidar.place_other("robot_b", at(x_m))
        (scan,) = lidar.add_transforms(transforms(time_ms))
        assert (scan.member == MEMBERS_A_ROBOT).sum() == on_ball(scan, x_m).sum() > 10


def test_our_own_body_hides_it_only_where_it_stands_between():
    lidar = looking(self_hits=False)
    lidar.place_other("robot_b", at(0.0, 2.0))
    lidar.set_other("robot_b", ball())
    (scan,) = lidar.add_transforms(transforms(0, SE3.rot("z", 0.5)))
    T_world_body = SE3.rot("z", 0.5)
    in_world = T_world_body.apply(scan.points_m[scan.member == MEMBERS_A_ROBOT])
    assert len(in_world) > 10
    np.testing.assert_allclose(np.linalg.norm(in_world - [0.0, 2.0, 0.0], axis=1), 0.3, atol=0.02)


def test_a_filter_of_our_own_body_leaves_it_in():
    lidar = looking(body_filter=True)
    lidar.set_other("robot_b", ball())
    lidar.place_other("robot_b", at(2.0))
    (scan,) = lidar.add_transforms(transforms(0))
    assert MEMBERS_A_ROBOT in scan.member


def test_numbers_of_one_robot_do_not_hang_on_whether_another_is_known():
    lidar = looking(("robot_b", "robot_c"))
    lidar.set_other("robot_c", ball())
    lidar.place_other("robot_c", at(2.0))
    (scan,) = lidar.add_transforms(transforms(0))
    assert set(scan.member.tolist()) == {0, 2 * MEMBERS_A_ROBOT}
    lidar.set_other("robot_b", ball())
    lidar.place_other("robot_b", at(-2.0))
    (scan,) = lidar.add_transforms(transforms(100))
    assert set(scan.member.tolist()) == {0, MEMBERS_A_ROBOT, 2 * MEMBERS_A_ROBOT}


def test_with_a_rolling_shutter_it_moves_within_a_revolution_and_may_come_in_the_middle_of_one():
    lidar = looking(rolling_shutter=True)
    lidar.set_other("robot_b", ball())
    scans = []
    for time_ms in range(0, 310, 10):
        if time_ms >= 50:
            lidar.place_other("robot_b", at(2.0, 0.01 * (time_ms - 250)))
        scans += lidar.add_transforms(transforms(time_ms))
    assert [scan.stamp_ns for scan in scans] == [100_000_000, 200_000_000]
    y_m = scans[1].points_m[scans[1].member == MEMBERS_A_ROBOT, 1]
    assert len(y_m) > 5
    assert not on_ball(scans[1], 2.0)[scans[1].member == MEMBERS_A_ROBOT].all(), "it was not always in the middle"


def test_the_depth_camera_sees_it_too(backend):
    camera = DepthCamera(
        DepthConfig.model_validate({"preset": "ideal", "truth": True, "frame": "lidar", "backend": backend}),
        1,
        lambda: False,
        other_robots=("robot_b",),
    )
    camera.set_robot(robot())
    camera.set_structure(structure())
    looking_along_x = SE3.rot("y", np.pi / 2)  # the optical axis, z, along the world's x
    assert MEMBERS_A_ROBOT not in camera.image(transforms(0, looking_along_x)).member
    camera.set_other("robot_b", ball())
    camera.place_other("robot_b", at(2.0))
    image, _ = camera.add_transforms(transforms(100, looking_along_x))
    is_ball = image.member == MEMBERS_A_ROBOT
    assert is_ball.sum() > 1000
    assert image.depth_mm[is_ball].min() == pytest.approx(1700, abs=5)


def test_what_does_not_fit_is_refused_and_changes_nothing():
    lidar = looking()
    lidar.set_other("robot_b", ball())
    lidar.place_other("robot_b", at(2.0))
    with pytest.raises(MessageError, match="robot_b: its transforms begin at 'odom', must begin at 'world'"):
        lidar.place_other("robot_b", at(1.0, root="odom"))
    with pytest.raises(MessageError, match="robot_b: its transforms do not reach every link of its robot_description"):
        lidar.place_other("robot_b", at(1.0, children=("base", "head")))
    with pytest.raises(InputFileError, match="robot_b/robot_description"):
        lidar.set_other("robot_b", ball("<robot"))
    (scan,) = lidar.add_transforms(transforms(0))
    assert (scan.member == MEMBERS_A_ROBOT).sum() == on_ball(scan, 2.0).sum() > 10


def test_another_body_waits_until_its_links_are_placed():
    others = OtherRobots(["robot_b"])
    others.place("robot_b", at(2.0))
    others.set_robot("robot_b", ball(BALL.replace('"ball"', '"head"')))
    assert others.shapes == ((),)
    assert others.place("robot_b", at(2.0, children=("base", "head")))
    ((head,),) = others.shapes
    assert (head.link, head.name) == ("robot_b/head", "robot_b/head")


@pytest.mark.parametrize(
    ("others", "problem"),
    [
        ("[robot_a]", "sensors.other_robots has the robot's own namespace robot_a"),
        ("[robot_b, robot_b]", "other_robots names one twice: robot_b, robot_b"),
        ("['']", "should match pattern"),
        ("[robot/*]", "should match pattern"),
    ],
)
def test_names_that_cannot_be_are_refused(others, problem):
    with pytest.raises(ConfigError, match=problem.replace("[", r"\[")):
        load_config(overrides=["bus.namespace=robot_a", f"sensors.other_robots={others}"])
