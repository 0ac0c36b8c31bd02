"""The robot as the configuration has it: its URDF with the sensors where their mounts say."""

import numpy as np
import pytest

from services.sim.node import load_sim
from shared.climbing.climber import load_climber
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import RobotDescription, Transforms
from shared.robot.configured import robot_urdf
from shared.robot.kinematics import LINKS
from shared.robot.urdf import parse_urdf
from shared.runtime.config_loading import load_config
from tests.support.robots import MODEL, URDF, only

REAR = (
    "sensors.others.lidar_rear={kind: lidar, frame: lidar_rear, mount: {xyz_m: [-0.05, 0, 0.02], rpy_deg: [0, 0, 180]}}"
)
OLD_URDF = URDF.replace('"depth', '"eye').replace("depth_optical", "eye_optical")


def with_robot(tmp_path, urdf, *overrides):
    path = tmp_path / "robot.urdf"
    path.write_text(urdf)
    return load_config(overrides=[f"robot={path}", *overrides])


def test_the_shipped_robot_is_published_as_it_is():
    assert robot_urdf(load_config()) == URDF


def test_a_sensor_s_mount_places_its_link():
    override = "sensors.depth.mount={parent: platform_b, xyz_m: [0.1, 0, 0.2], rpy_deg: [0, 90, 0]}"
    model = parse_urdf(robot_urdf(load_config(overrides=[override])), "robot")
    (joint,) = (joint for joint in model.joints if joint.child == "depth")
    assert joint.parent == "platform_b"
    expected = SE3.rot("y", np.pi / 2).matrix + np.array([0.1, 0, 0.2, 0])[:, None] * [0, 0, 0, 1]
    np.testing.assert_allclose(joint.T_parent_child().matrix, expected, atol=1e-12)


def test_the_simulation_publishes_a_mounted_sensor_and_where_it_is():
    sim = load_sim(load_config(overrides=[REAR]))
    try:
        messages = sim.start()
    finally:
        sim.close()
    assert "lidar_rear" in parse_urdf(only(RobotDescription, messages).urdf, "robot").links
    transforms = only(Transforms, messages)
    tree = FrameTree(transforms)
    T_hip_rear = tree.T_root("hip").inv() @ tree.T_root("lidar_rear")
    np.testing.assert_allclose(T_hip_rear.matrix, SE3.from_rpy((0, 0, np.pi), (-0.05, 0, 0.02)).matrix, atol=1e-9)
    T_depth_optical = tree.T_root("depth").inv() @ tree.T_root("depth_optical")
    np.testing.assert_allclose(T_depth_optical.rotation @ [0, 0, 1], [1, 0, 0], atol=1e-9)


def test_what_climbs_carries_its_sensors_where_they_are_mounted():
    """The LiDAR's mass goes along with its mount: on the foot instead of on the hip."""
    on_hip, on_foot = (
        load_climber(load_config(overrides=text)) for text in ([], ["sensors.lidar.mount={parent: foot_b}"])
    )
    moved = on_foot.holding.masses.mass_kg - on_hip.holding.masses.mass_kg
    np.testing.assert_allclose(moved[[LINKS.index("hip"), LINKS.index("foot_b")]], [-0.447, 0.447], atol=1e-12)


@pytest.mark.parametrize(
    ("override", "reason"),
    [
        (
            "sensors.others.lidar_rear={kind: lidar, frame: rear}",
            r"^sensors\.others\.lidar_rear\.frame: .*hyrecro\.urdf has no link 'rear', and there is no "
            r"sensors\.others\.lidar_rear\.mount to add it; links are foot_a, .*foot_b$",
        ),
        (
            "sensors.lidar.mount={parent: hips}",
            r"hyrecro\.urdf: sensors\.lidar\.mount: no link 'hips'; links are foot_a",
        ),
        ("sensors.lidar.frame=foot_b", None),
        ("sensors.lidar={frame: foot_b, mount: {}}", r"sensors\.lidar\.mount: link 'foot_b' moves by joint 'q8'"),
    ],
)
def test_what_cannot_be_is_refused_by_its_setting(override, reason):
    config = load_config(overrides=[override])
    if reason is None:
        assert robot_urdf(config) == URDF
        return
    for load in (robot_urdf, load_sim, load_climber):
        with pytest.raises(InputFileError, match=reason):
            load(config)


def test_a_robot_without_camera_needs_a_mount_or_none_enabled(tmp_path):
    with pytest.raises(InputFileError, match=r"sensors\.depth\.frame: .*robot\.urdf has no link 'depth_optical'"):
        robot_urdf(with_robot(tmp_path, OLD_URDF))
    assert robot_urdf(with_robot(tmp_path, OLD_URDF, "sensors.depth.enabled=false")) == OLD_URDF
    model = parse_urdf(robot_urdf(with_robot(tmp_path, OLD_URDF, "sensors.depth.mount={}")), "robot")
    assert model.links[-2:] == ("depth", "depth_optical")


# ---- the shipped camera


def fixed(link):
    (joint,) = (joint for joint in MODEL.joints if joint.child == link)
    assert (joint.kind, joint.parent) == ("fixed", "hip")
    return joint.T_parent_child()


def test_the_camera_is_below_the_lidar_s_lowest_beam():
    """Which is 22.8 degrees down: the corners of the housing are lower."""
    (housing,) = (shape for shape in MODEL.shapes if shape.link == "depth")
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2 * housing.solid.size_m
    T_lidar_housing = fixed("lidar").inv() @ fixed("depth") @ housing.T_link_shape
    x, y, z = T_lidar_housing.apply(corners).T
    assert np.rad2deg(np.arctan2(z, np.hypot(x, y))).max() < -23.5


def test_the_camera_weighs_nothing_and_touches_nothing():
    assert [MODEL.inertias[link].mass_kg for link in ("depth", "depth_optical")] == [0.0, 0.0]
    assert not {"depth", "depth_optical"} & {shape.link for shape in MODEL.collisions}


def test_the_camera_looks_ahead_and_down_over_the_hip_plate_s_end():
    T_hip_depth = fixed("depth")
    ahead = T_hip_depth.rotation[:, 0]
    np.testing.assert_allclose(ahead, [np.cos(np.deg2rad(15)), 0, -np.sin(np.deg2rad(15))], atol=1e-12)
    lowest = np.deg2rad(15 + 58.3 / 2)
    (plate,) = (shape for shape in MODEL.shapes if shape.link == "hip")
    end_m = plate.T_link_shape.translation[0] + plate.solid.size_m[0] / 2
    top_m = plate.T_link_shape.translation[2] + plate.solid.size_m[2] / 2
    x, _, z = T_hip_depth.translation
    assert z - (end_m - x) * np.tan(lowest) > top_m
