"""The LiDAR's facade: when it scans, from where, and what it does with what does not fit."""

import numpy as np
import pytest

from services.sensors.lidar.scanner import LidarScanner
from shared.deskew import deskewed
from shared.errors import InputFileError, MessageError
from shared.geometry import SE3
from shared.messaging.messages import Transforms
from shared.motion import Motion
from tests.support.sensing import ROBOT, beams, lidar_config, robot, scanner, structure, transforms


@pytest.fixture(params=["scan_conversion", "embree"])
def backend(request):
    return request.param


def stamps_ms(lidar, *times_ms):
    return [scan.stamp_ns / 1e6 for time_ms in times_ms for scan in lidar.add_transforms(transforms(time_ms))]


def moving(**changes):
    return lidar_config(rolling_shutter=True, **changes)


def turning(time_ms, rate_radps=1.0):
    return SE3.rot("z", rate_radps * time_ms / 1e3) @ SE3.trans(0.5, 0.3, 0.1)


def test_points_lie_on_the_walls_in_the_sensors_frame(backend):
    T_world_body = SE3.trans(1.0, 0.5, 0.2) @ SE3.rot("z", 0.7)
    (scan,) = scanner(lidar_config(backend=backend)).add_transforms(transforms(0, T_world_body))
    assert (scan.frame, scan.stamp_ns, len(scan.points_m)) == ("lidar", 0, 16 * 8)
    in_world = T_world_body.apply(scan.points_m)
    np.testing.assert_allclose((np.abs(in_world) / [4, 3, 2]).max(axis=1), 1.0, atol=1e-5)


def test_points_go_ring_by_ring_at_one_time():
    (scan,) = scanner().add_transforms(transforms(0))
    assert scan.ring.tolist() == [ring for ring in range(8) for _ in range(16)]
    assert scan.t_ns.tolist() == [0] * (8 * 16)


def test_columns_of_a_rolling_shutter_tell_when_they_fired():
    lidar = scanner(moving(), beams(num_columns=16, num_rings=2))
    (scan,) = [scan for time_ms in (0, 50, 100) for scan in lidar.add_transforms(transforms(time_ms))]
    assert scan.t_ns.tolist() == [column * 6_250_000 for column in range(16)] * 2


def test_the_robot_sees_itself_unless_told_otherwise(backend):
    down = beams(8, 2, -80, -89)
    (scan,) = scanner(lidar_config(backend=backend), down).add_transforms(transforms(0))
    np.testing.assert_allclose(scan.points_m[8:, 2], -0.8, atol=1e-5)
    (blind,) = scanner(lidar_config(backend=backend, self_hits=False), down).add_transforms(transforms(0))
    np.testing.assert_allclose(blind.points_m[8:, 2], -2.0, atol=1e-5)


def test_the_body_filter_takes_out_what_met_the_robot_and_what_it_hides():
    down = beams(8, 2, -70, -89)
    (scan,) = scanner(lidar_config(body_filter=True), down).add_transforms(transforms(0))
    assert set(scan.ring.tolist()) == {0}
    assert len(scan.ring) == 8


def test_the_truth_names_member_face_and_range_when_asked():
    T_world_body = SE3.trans(1.0, 0.5, 0.2)
    (scan,) = scanner(lidar_config(truth=True, range_noise_m=0.01)).add_transforms(transforms(0, T_world_body))
    np.testing.assert_array_equal(scan.member, 0)
    along_x = np.abs(T_world_body.apply(scan.points_m)[:, 0]) > 3.9
    assert set(scan.face[along_x].tolist()) == {0, 1}
    errors_m = np.linalg.norm(scan.points_m, axis=1) - scan.true_range_m
    assert 0.005 < errors_m.std() < 0.015
    (plain,) = scanner().add_transforms(transforms(0))
    assert (plain.member, plain.face, plain.true_range_m) == (None, None, None)


def test_the_same_seed_gives_the_same_scans():
    noisy = lidar_config(range_noise_m=0.008)
    first, again, other = (scanner(noisy, seed=seed).add_transforms(transforms(0))[0] for seed in (3, 3, 4))
    assert first == again
    assert first != other


def test_a_scans_noise_depends_on_its_moment_and_not_on_those_before():
    noisy = lidar_config(range_noise_m=0.008)
    lidar, late = scanner(noisy), scanner(noisy)
    first, second = (lidar.add_transforms(transforms(time_ms))[0] for time_ms in (0, 100))
    np.testing.assert_array_equal(late.add_transforms(transforms(100))[0].points_m, second.points_m)
    assert (first.points_m != second.points_m).any(axis=1).all()


def test_scans_stand_on_the_multiples_of_the_period():
    assert stamps_ms(scanner(), *range(0, 350, 10)) == [0, 100, 200, 300]
    assert stamps_ms(scanner(lidar_config(mode="512x20")), *range(0, 160, 10)) == [0, 50, 100, 150]


def test_lost_transforms_shift_no_later_scan_and_make_none_up():
    assert stamps_ms(scanner(), 0, 90, 130, 140, 190, 210, 450, 460, 500) == [0, 130, 210, 450, 500]


def test_a_restarted_simulation_is_followed_from_its_beginning():
    assert stamps_ms(scanner(), 5000, 5050, 0, 50, 100) == [5000, 0, 100]


def test_a_revolution_is_scanned_when_it_is_over():
    assert stamps_ms(scanner(moving()), *range(0, 310, 10)) == [0, 100, 200]
    assert stamps_ms(scanner(moving()), *range(30, 310, 10)) == [100, 200]


def test_a_revolution_of_which_transforms_are_missing_is_scanned_if_its_ends_are_near():
    assert stamps_ms(scanner(moving()), 0, 40, 90, 130, 170, 210, 290, 305) == [0, 100, 200]
    assert stamps_ms(scanner(moving()), 0, 50, 160, 200, 250, 300) == [200]


def test_a_revolution_is_started_anew_when_time_goes_back():
    assert stamps_ms(scanner(moving()), 5000, 5050, 5100, 20, 50, 100, 150, 200) == [5000, 100]


def test_a_moving_scan_is_bent_and_true_motion_straightens_it(backend):
    fine = beams(256, 16)
    lidar = scanner(moving(backend=backend), fine)
    known = [(time_ms, turning(time_ms)) for time_ms in range(0, 110, 10)]
    (scan,) = [scan for time_ms, pose in known for scan in lidar.add_transforms(transforms(time_ms, pose))]
    motion = Motion([time_ms * 10**6 for time_ms, _ in known], [[pose.xyz_quat_xyzw] for _, pose in known])
    as_it_stands = turning(0).apply(scan.points_m)
    straight = turning(0).apply(deskewed(scan, motion))
    distance_m = [np.abs((np.abs(points) - [4, 3, 2]).max(axis=1)) for points in (as_it_stands, straight)]
    assert distance_m[0].max() > 0.2
    assert distance_m[1].max() < 2e-5


def test_it_is_silent_until_it_knows_what_there_is_to_see():
    lidar = LidarScanner(lidar_config(), beams(), 1)
    assert lidar.add_transforms(transforms(0)) == []
    with pytest.raises(MessageError, match="needs the descriptions"):
        lidar.scan([transforms(0)])
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
