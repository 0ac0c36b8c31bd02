import numpy as np
import pytest

from services.sensors.depth.camera import DepthCamera, pinhole_of
from services.sensors.depth.effect_kernels import match
from services.sensors.loading import warm_up
from services.sensors.rays.camera_kernels import draw, finish
from shared.depth_points import points_of
from shared.errors import InputFileError, MessageError
from shared.geometry import SE3
from shared.messaging.messages import (
    CameraInfo,
    DepthImage,
    PointCloud,
    RobotDescription,
    StructureDescription,
    Transforms,
)
from shared.runtime.sensor_config import DepthConfig

ROBOT = """<robot name="r">
  <link name="body"><visual><origin xyz="0 0.3 0.8"/><geometry><box size="0.4 0.4 0.4"/></geometry></visual></link>
  <link name="depth_optical"/>
  <joint name="mount" type="fixed"><parent link="body"/><child link="depth_optical"/></joint>
</robot>"""
ROOM = """<robot name="s"><link name="world">
  <visual><geometry><box size="4 4 4"/></geometry></visual>
  <visual><origin xyz="0 0 1.5"/><geometry><box size="0.2 0.2 0.2"/></geometry></visual>
</link></robot>"""


def config(**settings):
    return DepthConfig.model_validate({"preset": "ideal", "rate_hz": 15, **settings})


def robot(urdf=ROBOT):
    return RobotDescription(stamp_ns=0, seq=0, frame="body", urdf=urdf)


def structure(urdf=ROOM):
    return StructureDescription(stamp_ns=0, seq=0, frame="world", urdf=urdf)


def transforms(stamp_ms, T_world_body=None, children=("body", "depth_optical")):
    poses = [(T_world_body or SE3.identity()).xyz_quat_xyzw, SE3.identity().xyz_quat_xyzw]
    return Transforms(
        stamp_ns=round(stamp_ms * 1e6),
        seq=0,
        frame="world",
        parents=("world", "body"),
        children=children,
        T_parent_child=np.array(poses),
    )


def depth_camera(seed=1, wants_points=False, **settings):
    camera = DepthCamera(config(**settings), seed, lambda: wants_points)
    assert camera.set_robot(robot()) == []
    assert camera.set_structure(structure()) == []
    return camera


def stamps_ms(camera, *times_ms):
    return [messages[0].stamp_ns / 1e6 for t in times_ms if (messages := camera.add_transforms(transforms(t)))]


def image_of(camera, at=None):
    image = camera.image(at or transforms(0))
    return image.depth_mm.reshape(image.height, image.width)


def test_an_image_has_its_intrinsics_and_a_cloud_only_if_wanted():
    image, info = depth_camera().add_transforms(transforms(7))
    assert isinstance(image, DepthImage)
    assert isinstance(info, CameraInfo)
    assert {(each.stamp_ns, each.frame, each.seq) for each in (image, info)} == {(7_000_000, "depth_optical", 0)}
    assert (image.height, image.width, info.height, info.width) == (480, 848, 480, 848)
    assert info.fx == info.fy == pytest.approx(427, abs=0.1)
    assert (info.cx, info.cy) == (423.5, 239.5)
    assert image.member is image.face is image.true_depth_m is None
    assert len(depth_camera(wants_points=True).add_transforms(transforms(0))) == 3


def test_whether_points_are_wanted_is_asked_at_each_image():
    answers = [True, False, True]
    camera = DepthCamera(config(), 1, lambda: answers.pop(0))
    camera.set_robot(robot())
    camera.set_structure(structure())
    assert [len(camera.add_transforms(transforms(t))) for t in (0, 100, 200)] == [3, 2, 3]


@pytest.mark.parametrize(("mode", "focal_px"), [("848x480", 427.0), ("1280x720", 644.5)])
def test_the_focal_length_follows_from_the_field_of_view(mode, focal_px):
    camera = pinhole_of(config(mode=mode))
    assert camera.fx == pytest.approx(focal_px, abs=0.1)
    edges = camera.rays()[0, [0, -1], 0] + np.array([-0.5, 0.5]) / camera.fx
    np.testing.assert_allclose(np.rad2deg(np.arctan(edges)), [-44.8, 44.8])


def test_depths_are_along_the_optical_axis():
    T_world_body = SE3.trans(0.3, -0.2, -1.0)
    depth_mm = image_of(depth_camera(), transforms(0, T_world_body))
    assert depth_mm[239, 0] == round(1000 * 2.3 / (423.5 / pinhole_of(config()).fx))  # the wall to the left
    assert depth_mm[0, 424] == 3000  # the wall ahead
    assert depth_mm[275, 370] == 2400  # the small box
    assert depth_mm[400, 424] == 600  # the robot


def test_points_lie_on_the_walls_in_the_optical_frame():
    T_world_body = SE3.trans(0.5, 0.2, -0.3) @ SE3.rot("z", 0.7) @ SE3.rot("x", 1.1)
    _, _, cloud = depth_camera(wants_points=True, self_hits=False).add_transforms(transforms(0, T_world_body))
    assert isinstance(cloud, PointCloud)
    assert cloud.frame == "depth_optical"
    in_world = np.abs(T_world_body.apply(cloud.points_m.astype(float)))
    assert len(in_world) == 848 * 480
    on_room = np.abs(in_world.max(axis=1) - 2.0)
    on_box = np.abs(np.abs(in_world - [0, 0, 1.5]).max(axis=1) - 0.1)
    assert np.minimum(on_room, on_box).max() < 0.0012  # half a millimetre of depth, at most 55 degrees off the axis


def test_the_robot_is_in_view_if_it_shall_be():
    assert image_of(depth_camera())[400, 424] == 600
    assert image_of(depth_camera(self_hits=False))[400, 424] > 600


def test_truth_says_what_each_pixel_met():
    plain, true = depth_camera(max_range_m=0.9), depth_camera(truth=True, max_range_m=0.9)
    assert plain.image(transforms(0)).member is None
    image = true.image(transforms(0, SE3.trans(z_m=1.0)))
    shape = (image.height, image.width)
    member, face, depth_m = (each.reshape(shape) for each in (image.member, image.face, image.true_depth_m))
    assert (member[240, 424], face[240, 424]) == (1, 4)  # the box's lower side, -z
    assert depth_m[240, 424] == pytest.approx(0.4)
    assert (member[240, 0], face[240, 0]) == (0, 5)  # the room's, seen from within
    assert (member[400, 424], face[400, 424]) == (2, 4)  # the robot's only shape
    assert image.depth_mm.reshape(shape)[240, 0] == 0
    assert depth_m[240, 0] == pytest.approx(1.0)
    away = depth_camera(truth=True, self_hits=False).image(transforms(0, SE3.trans(x_m=99.0)))
    assert (away.member == -1).all()
    assert (away.face == -1).all()
    assert not away.true_depth_m.any()


def test_the_backends_give_the_same_image():
    at = transforms(0, SE3.from_rpy((0.3, 0.2, 0.5), (0.3, -0.2, -1.0)))
    first, second = (
        image_of(depth_camera(backend=backend), at).astype(int) for backend in ("scan_conversion", "embree")
    )
    assert (np.abs(first - second) > 1).mean() < 1e-5


def test_the_same_seed_gives_the_same_image_whatever_came_before():
    first, again, other = (depth_camera(seed, preset="datasheet") for seed in (3, 3, 4))
    again.add_transforms(transforms(0))
    assert (image_of(first, transforms(500)) == image_of(again, transforms(500))).all()
    assert (image_of(first, transforms(500)) != image_of(other, transforms(500))).any()
    assert (image_of(first, transforms(500)) != image_of(first, transforms(600))).any()


def test_images_stand_on_the_multiples_of_the_period():
    assert stamps_ms(depth_camera(rate_hz=30), *range(0, 210, 10)) == [0, 40, 70, 100, 140, 170, 200]


def test_lost_transforms_shift_no_later_image_and_make_none_up():
    assert stamps_ms(depth_camera(rate_hz=15), 0, 60, 90, 100, 130, 140, 450, 460, 470) == [0, 90, 140, 450, 470]


def test_a_restarted_simulation_is_followed_from_its_beginning():
    assert stamps_ms(depth_camera(rate_hz=15), 5010, 5050, 0, 50, 100) == [5010, 0, 100]


def test_it_is_silent_until_it_knows_what_there_is_to_see():
    camera = DepthCamera(config(), 1, lambda: False)
    assert camera.add_transforms(transforms(0)) == []
    camera.set_structure(structure())
    assert camera.add_transforms(transforms(100)) == []
    camera.set_robot(robot())
    assert [messages[0].seq for k in (2, 3) if (messages := camera.add_transforms(transforms(100 * k)))] == [0, 1]


def test_a_new_structure_is_seen_from_then_on():
    camera = depth_camera()
    before = image_of(camera)
    camera.set_structure(structure(ROOM.replace("4 4 4", "6 6 6")))
    assert image_of(camera)[0, 424] == before[0, 424] + 1000


def test_descriptions_and_transforms_that_do_not_fit():
    with pytest.raises(InputFileError, match="no link 'depth_optical' for the depth; links are body"):
        depth_camera().set_robot(robot('<robot name="r"><link name="body"/></robot>'))
    with pytest.raises(InputFileError, match="not well-formed"):
        depth_camera().set_structure(structure("<robot <"))
    with pytest.raises(InputFileError, match="must be one link, is body, depth_optical"):
        depth_camera().set_structure(structure(ROBOT))
    with pytest.raises(MessageError, match="no path from 'world' to frame 'depth_optical'"):
        depth_camera().add_transforms(transforms(0, children=("body", "camera")))
    with pytest.raises(MessageError, match="needs the descriptions of robot and structure first"):
        DepthCamera(config(), 1, lambda: False).image(transforms(0))


def test_what_an_image_takes_is_compiled_beforehand():
    warm_up(config(preset="datasheet"))
    kernels = (draw, finish, match, points_of)
    compiled = [list(kernel.signatures) for kernel in kernels]
    depth_camera(wants_points=True, preset="datasheet").add_transforms(transforms(0))
    assert [list(kernel.signatures) for kernel in kernels] == compiled
