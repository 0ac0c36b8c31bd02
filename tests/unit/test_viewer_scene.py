"""What the viewer draws of which message."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib import colormaps

from services.viewer import colours
from services.viewer.drawing import Drawing, Edges, Model
from services.viewer.scene import ESTIMATED_TRAIL, FIXED_FOOT_STATE, TRUE_TRAIL, Scene, has_picture
from services.viewer.trail import Trail
from shared.messaging import channels as c, messages as m
from tests.support.examples import EXAMPLES

AT = {"stamp_ns": 2_000_000_000, "seq": 0}


def drawn(channel, *messages):
    scene = Scene()
    return [item for message in messages for item in scene.draw(channel, message)]


def component(drawing, name):
    batches = drawing.archetype.as_component_batches()
    (batch,) = [batch for batch in batches if batch.component_descriptor().component == name]
    return batch.as_arrow_array().to_pylist()


def rgb(packed):
    return (packed >> 24) & 255, (packed >> 16) & 255, (packed >> 8) & 255


def scan(points_m):
    points_m = np.array(points_m, np.float32)
    num = len(points_m)
    zeros = {"intensity": np.zeros(num, np.float32), "t_ns": np.zeros(num, np.uint32), "ring": np.zeros(num, np.uint16)}
    return m.LidarScan(**AT, frame="lidar", points_m=points_m, **zeros)


def test_a_scan_is_coloured_by_range():
    half = colours.MAX_RANGE_M / 2
    (drawing,) = drawn(c.LIDAR_POINTS, scan([[0, 0, 0], [0, half, 0], [0, 0, 99.0], [-half, 0, 0]]))
    table = [tuple(row) for row in colormaps["turbo"](np.arange(256), bytes=True)[:, :3].tolist()]
    colours_drawn = [rgb(packed) for packed in component(drawing, "Points3D:colors")]
    assert colours_drawn == [table[0], table[127], table[255], table[127]]
    assert (drawing.entity, drawing.stamp_ns, drawing.frame) == ("lidar/points", 2_000_000_000, "lidar")


def test_the_scan_of_another_sensor_is_drawn_beside_it():
    channel = c.LIDAR_POINTS.of_sensor("lidar_rear")
    (drawing,) = drawn(channel, scan([[1, 0, 0]]))
    assert drawing.entity == "lidar_rear/points"
    assert has_picture(channel)


def test_planes_are_outlines_in_their_colours():
    outline_m = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    plane = m.Plane(
        id=1, coefficients=[0, 0, 1.0, 0], num_inliers=9, outline_m=outline_m, colour=np.array([1.0, 0.5, 0.0])
    )
    (drawing,) = drawn(c.MAP_PLANES, m.PlaneMap(**AT, frame="map", planes=(plane,)))
    assert component(drawing, "LineStrips3D:strips") == [[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0]]]
    assert [rgb(packed) for packed in component(drawing, "LineStrips3D:colors")] == [(255, 128, 0)]


def test_descriptions_are_models():
    said = m.RobotDescription(**AT, frame="foot_a", urdf="<robot/>")
    assert drawn(c.ROBOT_DESCRIPTION, said) == [Model("robot", "<robot/>")]


def transforms(x_m, stamp_ns=0):
    return m.Transforms(
        stamp_ns=stamp_ns,
        seq=0,
        frame="world",
        parents=("world",),
        children=("lidar",),
        T_parent_child=np.array([[x_m, 0, 0, 0, 0, 0, 1.0]]),
    )


def odometry(x_m):
    pose = np.array([x_m, 0, 0, 0, 0, 0, 1.0])
    return m.Odometry(**AT, frame="map", child_frame="lidar_estimated", T_frame_child=pose)


def test_transforms_move_frames():
    (edges,) = drawn(c.TF, transforms(1.5))
    assert isinstance(edges, Edges)
    assert (edges.parents, edges.children, edges.T_parent_child[0, 0]) == (("world",), ("lidar",), 1.5)


def test_a_sensor_of_unknown_place_is_where_it_is_believed_to_be():
    scene = Scene()
    (edges,) = scene.draw(c.MAP_ODOMETRY, odometry(0.5))
    assert (edges.parents, edges.children) == (("map", "lidar_estimated"), ("lidar_estimated", "lidar"))
    np.testing.assert_array_equal(edges.T_parent_child[1], [0, 0, 0, 0, 0, 0, 1])
    list(scene.draw(c.TF, transforms(0.0)))
    (edges,) = scene.draw(c.MAP_ODOMETRY, odometry(0.5))
    assert (edges.parents, edges.children) == (("map",), ("lidar_estimated",))


def test_static_transforms_hold_at_all_times():
    (edges,), (static,) = drawn(c.TF, transforms(1.5, 7)), drawn(c.TF_STATIC, transforms(1.5, 7))
    assert (edges.stamp_ns, static.stamp_ns) == (7, None)


def test_the_way_estimated_and_the_true_one_are_lines():
    scene = Scene()
    said = [odometry(0.0), transforms(0.0), odometry(0.1), transforms(0.1)]
    channels = {m.Odometry: c.MAP_ODOMETRY, m.Transforms: c.TF}
    items = [item for message in said for item in scene.draw(channels[type(message)], message)]
    lines = {item.entity: item for item in items if isinstance(item, Drawing)}
    assert lines.keys() == {ESTIMATED_TRAIL, TRUE_TRAIL}
    for entity, frame in ((ESTIMATED_TRAIL, "map"), (TRUE_TRAIL, "world")):
        np.testing.assert_allclose(component(lines[entity], "LineStrips3D:strips"), [[[0, 0, 0], [0.1, 0, 0]]])
        assert lines[entity].frame == frame


def test_without_an_estimate_no_way_is_drawn():
    assert [type(item) for item in drawn(c.TF, transforms(0.0), transforms(0.1))] == [Edges, Edges]


def steps(trail, xs_m):
    return [trail.step(np.array([x_m, 0.0, 0.0])) is not None for x_m in xs_m]


def test_a_trail_waits_for_a_step():
    assert steps(Trail(0.01), [0.0, 0.005, 0.009, 0.011, 0.02, 5.0]) == [False, False, False, True, False, True]


def test_a_dashed_trail_leaves_out_every_second_line():
    assert steps(Trail(0.01, is_dashed=True), [0.0, 0.02, 0.04, 0.06, 0.08]) == [False, True, False, True, False]


def test_the_fixed_foot_is_said_when_it_changes():
    legs = next(message for message in EXAMPLES if isinstance(message, m.LegState) and message.margin == 0.4)
    items = drawn(c.LEG_STATE, legs, legs, replace(legs, fixed_foot=m.Foot.B, margin=None))
    assert [component(item, "StateChange:state") for item in items if item.entity == FIXED_FOOT_STATE] == [["A"], ["B"]]
    assert [component(item, "Scalars:scalars") for item in items if item.entity == "leg/state/margin"] == [[0.4], [0.4]]


def test_a_wide_depth_image_is_thinned_with_its_camera():
    image = m.DepthImage(**AT, frame="depth_optical", height=2, width=960, depth_mm=np.arange(1920, dtype=np.uint16))
    info = m.CameraInfo(**AT, frame="depth_optical", height=2, width=960, fx=600.0, fy=500.0, cx=480.0, cy=1.0)
    (picture,), (camera,) = drawn(c.DEPTH_IMAGE, image), drawn(c.DEPTH_CAMERA_INFO, info)
    data = np.array(component(picture, "DepthImage:buffer")[0], np.uint8).view("<u2")
    np.testing.assert_array_equal(data, np.arange(0, 960, 2))
    assert component(camera, "Pinhole:resolution") == [[480.0, 1.0]]
    assert component(camera, "Pinhole:image_from_camera") == [[300.0, 0, 0, 0, 250.0, 0, 240.0, 0.5, 1.0]]


def test_what_the_recorder_lost_is_said_once():
    lost = m.ChannelRecord(key="hyrecro/tf", num_received=9, num_lost_on_bus=2, num_lost_to_disk=1)
    kept = m.ChannelRecord(key="hyrecro/clock", num_received=9, num_written=9)
    status = m.RecorderStatus(
        **AT, frame="", is_recording=True, path="x", num_files=1, num_bytes=1, free_bytes=1, channels=(lost, kept)
    )
    (line,) = drawn(c.RECORDER_STATUS, status, status)
    assert component(line, "TextLog:text") == ["[recorder] lost so far: 3 of hyrecro/tf"]
    assert drawn(c.RECORDER_STATUS, replace(status, channels=(kept,))) == []


def test_of_every_channel_it_is_known_whether_it_has_a_picture():
    assert {channel.key for channel in c.CHANNELS if not channel.is_command and not has_picture(channel)} == {
        "actuators/state",
        "clock",
        "lidar/imu",
        "depth/imu",
        "depth/points",
        "health/*",
    }


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda message: type(message).__name__)
def test_every_message_with_a_picture_can_be_drawn(message):
    for channel in c.CHANNELS:
        if channel.message is type(message) and has_picture(channel):
            assert all(item.entity for item in drawn(channel, message))


def test_what_comes_too_often_is_not_due():
    scene = Scene()
    stamps_ns = [0, 10_000_000, 40_000_000, 50_000_000, 60_000_000]
    assert [scene.is_due(c.TF, ns) for ns in stamps_ns] == [True, False, False, True, False]
    assert scene.is_due(c.TF, 5_000_000), "time has begun anew"
    assert [scene.is_due(c.MAP_STATUS, ns) for ns in stamps_ns] == [True] * 5
