import numpy as np
import pytest

from services.sensors.lidar import LidarScanner
from shared.errors import InputFileError, MessageError
from shared.geometry import SE3
from shared.messaging.messages import RobotDescription, StructureDescription, Transforms
from shared.runtime.config import LidarConfig

ROBOT = """<robot name="r">
  <link name="body"><visual><origin xyz="0 0 -1"/><geometry><box size="0.4 0.4 0.4"/></geometry></visual></link>
  <link name="lidar"/>
  <joint name="mount" type="fixed"><parent link="body"/><child link="lidar"/></joint>
</robot>"""
ROOM = """<robot name="s"><link name="world">
  <visual><geometry><box size="8 6 4"/></geometry></visual>
</link></robot>"""
CONFIG = LidarConfig(num_columns=16, num_rings=8, range_noise_m=0.0)


def robot(urdf=ROBOT):
    return RobotDescription(stamp_ns=0, seq=0, frame="body", urdf=urdf)


def structure(urdf=ROOM):
    return StructureDescription(stamp_ns=0, seq=0, frame="world", urdf=urdf)


def transforms(stamp_ms, T_world_body=None):
    poses = [(T_world_body or SE3.identity()).xyz_quat_xyzw, SE3.identity().xyz_quat_xyzw]
    return Transforms(
        stamp_ns=round(stamp_ms * 1e6),
        seq=0,
        frame="world",
        parents=("world", "body"),
        children=("body", "lidar"),
        T_parent_child=np.array(poses),
    )


def scanner(config=CONFIG, seed=1):
    lidar = LidarScanner(config, np.random.default_rng(seed))
    assert lidar.set_robot(robot()) == []
    assert lidar.set_structure(structure()) == []
    return lidar


def stamps_ms(lidar, *times_ms):
    return [scan.stamp_ns / 1e6 for time_ms in times_ms for scan in lidar.add_transforms(transforms(time_ms))]


def test_points_lie_on_the_walls_in_the_sensors_frame():
    T_world_body = SE3.trans(1.0, 0.5, 0.2) @ SE3.rot("z", 0.7)
    (scan,) = scanner().add_transforms(transforms(0, T_world_body))
    assert (scan.frame, scan.stamp_ns, len(scan.points_m)) == ("lidar", 0, 16 * 8)
    in_world = T_world_body.apply(scan.points_m)
    np.testing.assert_allclose((np.abs(in_world) / [4, 3, 2]).max(axis=1), 1.0, atol=1e-5)


def test_points_go_ring_by_ring_at_one_time():
    (scan,) = scanner().add_transforms(transforms(0))
    assert scan.ring.tolist() == [ring for ring in range(8) for _ in range(16)]
    assert scan.t_ns.tolist() == [0] * (8 * 16)
    assert (scan.intensity > 0).all()
    assert (scan.intensity <= 255).all()


def test_a_wall_straight_ahead_returns_most():
    config = LidarConfig(num_columns=8, num_rings=2, max_elevation_deg=0.001, min_elevation_deg=0.0, range_noise_m=0.0)
    (scan,) = scanner(config).add_transforms(transforms(0))
    np.testing.assert_allclose(scan.intensity[:2], [255, 255 * np.sqrt(0.5)], rtol=1e-4)


def test_the_robot_sees_itself():
    down = LidarConfig(num_columns=8, num_rings=2, max_elevation_deg=-80, min_elevation_deg=-89, range_noise_m=0.0)
    (scan,) = scanner(down).add_transforms(transforms(0))
    np.testing.assert_allclose(scan.points_m[8:, 2], -0.8, atol=1e-5)


def test_what_is_out_of_range_is_left_out():
    (scan,) = scanner(LidarConfig(num_columns=16, num_rings=8, max_range_m=3.5)).add_transforms(transforms(0))
    ranges_m = np.linalg.norm(scan.points_m, axis=1)
    assert 0 < len(ranges_m) < 16 * 8
    assert ranges_m.max() <= 3.5


def test_the_same_seed_gives_the_same_scans():
    noisy = LidarConfig(num_columns=16, num_rings=8)
    first, again, other = (scanner(noisy, seed).add_transforms(transforms(0))[0] for seed in (3, 3, 4))
    assert first == again
    assert first != other


def test_scans_stand_on_the_multiples_of_the_period():
    assert stamps_ms(scanner(), *range(0, 350, 10)) == [0, 100, 200, 300]


def test_lost_transforms_shift_no_later_scan_and_make_none_up():
    assert stamps_ms(scanner(), 0, 90, 130, 140, 190, 210, 450, 460, 500) == [0, 130, 210, 450, 500]


def test_a_restarted_simulation_is_followed_from_its_beginning():
    assert stamps_ms(scanner(), 5000, 5050, 0, 50, 100) == [5000, 0, 100]


def test_it_is_silent_until_it_knows_what_there_is_to_see():
    lidar = LidarScanner(CONFIG, np.random.default_rng(1))
    assert lidar.add_transforms(transforms(0)) == []
    lidar.set_structure(structure())
    assert lidar.add_transforms(transforms(100)) == []
    lidar.set_robot(robot())
    assert [scan.seq for k in (2, 3) for scan in lidar.add_transforms(transforms(100 * k))] == [0, 1]


def test_descriptions_and_transforms_that_do_not_fit():
    with pytest.raises(InputFileError, match="no link 'lidar' for the lidar; links are body"):
        scanner().set_robot(robot('<robot name="r"><link name="body"/></robot>'))
    with pytest.raises(InputFileError, match="not well-formed"):
        scanner().set_structure(structure("<robot <"))
    with pytest.raises(InputFileError, match="must be one link, is body, lidar"):
        scanner().set_structure(structure(ROBOT))
    lonely = Transforms(
        stamp_ns=0, seq=0, frame="odom", parents=("odom",), children=("lidar",), T_parent_child=np.eye(7)[6:]
    )
    with pytest.raises(MessageError, match="no path from 'odom'"):
        scanner().add_transforms(lonely)
