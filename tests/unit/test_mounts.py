"""Mounts: the URDF afterwards has each sensor where its mount says, and is otherwise the same robot."""

import dataclasses

import numpy as np
import pytest

from shared.errors import InputFileError
from shared.geometry import SE3
from shared.robot.mounts import Mount, with_mounts
from shared.robot.statics import RobotMasses
from shared.robot.urdf import parse_urdf
from tests.support.robots import MODEL, URDF

T = SE3.from_rpy((0.1, -0.2, 3.0), (0.05, 0.01, 0.3))


def mount(frame, parent="hip", T_parent_body=T):
    return Mount(f"sensors.{frame}.mount", frame, parent, T_parent_body)


def mounted(*mounts, urdf=URDF):
    return parse_urdf(with_mounts(urdf, mounts, "robot"), "robot")


def joint_of(model, link):
    (joint,) = (joint for joint in model.joints if joint.child == link)
    return joint


def assert_placed(model, link, parent, T_parent_link):
    joint = joint_of(model, link)
    assert (joint.kind, joint.parent) == ("fixed", parent)
    np.testing.assert_allclose(joint.T_parent_child().matrix, T_parent_link.matrix, atol=1e-12)


def others_than(model, link):
    """What the document says of all other links, as text: a solid or a transform has no value to compare by."""
    return {
        "joints": [str(joint) for joint in model.joints if joint.child != link],
        "shapes": [str(shape) for shape in (*model.shapes, *model.collisions)],
        "links": [name for name in model.links if name != link],
    }


def test_without_mounts_the_text_stays():
    assert with_mounts(URDF, [], "robot") is URDF


def test_an_existing_link_moves_with_its_shapes_and_its_mass():
    model = mounted(mount("lidar", "platform_b"))
    assert_placed(model, "lidar", "platform_b", T)
    assert others_than(model, "lidar") == others_than(MODEL, "lidar")
    assert model.inertias["lidar"].mass_kg == MODEL.inertias["lidar"].mass_kg
    assert RobotMasses.from_urdf(model).mass_kg[5] == pytest.approx(RobotMasses.from_urdf(MODEL).mass_kg[5] + 0.447)


def test_a_new_link_is_added_without_shape_and_mass():
    model = mounted(mount("lidar_rear", "foot_b"))
    assert_placed(model, "lidar_rear", "foot_b", T)
    assert others_than(model, "lidar_rear") == others_than(MODEL, "lidar_rear")
    assert model.inertias["lidar_rear"].mass_kg == 0.0, "stated: pybullet would take 1 kg"


def test_the_mount_of_an_optical_frame_places_the_cameras_body():
    """Along x of the body it looks; its image's right is the body's right, -y, and down is -z (REP-103)."""
    model = mounted(mount("depth_rear_optical"))
    assert_placed(model, "depth_rear", "hip", T)
    optical = joint_of(model, "depth_rear_optical")
    assert (optical.kind, optical.parent) == ("fixed", "depth_rear")
    expected = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    np.testing.assert_allclose(optical.T_parent_child().matrix, SE3(expected, np.zeros(3)).matrix, atol=1e-12)


def test_an_optical_frame_that_exists_stays_where_it_is_on_its_body():
    lens = SE3.from_rpy((-1.5, 0.0, -1.5), (0.01, 0.02, 0.0))
    before = with_mounts(URDF, [mount("depth_a", T_parent_body=SE3.identity()), mount("eye", "depth_a", lens)], "robot")
    model = mounted(mount("depth_a_optical"), urdf=before.replace('"eye"', '"depth_a_optical"'))
    assert_placed(model, "depth_a", "hip", T)
    assert_placed(model, "depth_a_optical", "depth_a", lens)


def test_a_sensor_sits_on_another_whatever_their_order():
    for mounts in ([mount("eye", "arm"), mount("arm")], [mount("arm"), mount("eye", "arm")]):
        model = mounted(*mounts)
        assert_placed(model, "arm", "hip", T)
        assert_placed(model, "eye", "arm", T)


def test_mounting_twice_is_mounting_once():
    once = with_mounts(URDF, [mount("depth_rear_optical"), mount("lidar")], "robot")
    assert with_mounts(once, [mount("depth_rear_optical"), mount("lidar")], "robot") == once


@pytest.mark.parametrize(
    ("mounts", "reason"),
    [
        ([mount("lidar", "hipp")], "sensors.lidar.mount: no link 'hipp'; links are foot_a, leg_a_lower, .*foot_b"),
        ([mount("eye", "hipp")], "sensors.eye.mount: no link 'hipp'; links are .*, eye"),
        ([mount("lidar", "lidar")], "sensors.lidar.mount: link 'lidar' would carry itself: lidar on lidar"),
        ([mount("lidar", "eye"), mount("eye", "lidar")], "link 'lidar' would carry itself: lidar on eye on lidar"),
        ([mount("eye_optical", "eye_optical")], "'eye' would carry itself: eye_optical on eye on eye_optical"),
        ([mount("foot_b")], "sensors.foot_b.mount: link 'foot_b' moves by joint 'q8'"),
        ([mount("foot_a")], "sensors.foot_a.mount: link 'foot_a' is the root"),
        (
            [mount("eye"), dataclasses.replace(mount("eye"), setting="b")],
            "b: link 'eye' is placed by sensors.eye.mount",
        ),
        ([mount("x_optical", "lidar"), mount("y", "x_optical"), mount("x", "y")], "link 'x' is placed by"),
    ],
)
def test_what_cannot_be_mounted_is_named(mounts, reason):
    with pytest.raises(InputFileError, match=f"^robot: .*{reason}"):
        with_mounts(URDF, mounts, "robot")


def test_an_optical_frame_elsewhere_is_refused():
    urdf = with_mounts(URDF, [mount("eye", "foot_b")], "robot").replace('"eye"', '"eye_optical"')
    with pytest.raises(InputFileError, match="link 'eye_optical' must be on 'eye', is eye_optical on foot_b"):
        with_mounts(urdf, [mount("eye_optical")], "robot")


def test_a_document_that_is_no_robot_is_named():
    with pytest.raises(InputFileError, match="robot: not valid XML"):
        with_mounts("<robot>", [mount("lidar")], "robot")
