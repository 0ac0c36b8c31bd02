import numpy as np
import pytest

from shared.deskew import deskewed
from shared.geometry import SE3
from shared.messaging.messages import LidarScan
from shared.motion import Motion

START, END = SE3.trans(1.0, 2.0, 3.0), SE3.from_rpy((0.3, -0.2, 0.9), (2.0, 2.0, 1.0))


def motion(stamps_ns, *rows):
    return Motion(stamps_ns, [[pose.xyz_quat_xyzw for pose in row] for row in rows])


def test_rotation_goes_at_an_even_rate_and_translation_straight():
    R, t = motion([0, 100], [START], [END]).at([0, 25, 50, 100])
    steps = [SE3(R[i, 0].T @ R[i + 1, 0], np.zeros(3)).angle_rad for i in range(3)]
    np.testing.assert_allclose(steps, END.angle_rad * np.array([0.25, 0.25, 0.5]), rtol=1e-9)
    np.testing.assert_allclose(t[:, 0], [[1, 2, 3], [1.25, 2, 2.5], [1.5, 2, 2], [2, 2, 1]])
    np.testing.assert_allclose(R[3, 0], END.rotation, atol=1e-12)


def test_it_takes_the_short_way_round():
    R, _ = motion([0, 2], [SE3.rot("z", np.deg2rad(170))], [SE3.rot("z", np.deg2rad(-170))]).at([1])
    np.testing.assert_allclose(R[0, 0], SE3.rot("z", np.pi).rotation, atol=1e-12)


def test_before_and_after_it_stands_still():
    moving = motion([10, 20, 30], [START], [END], [END])
    R, t = moving.at([0, 25, 99])
    np.testing.assert_allclose(t[:, 0], [START.translation, END.translation, END.translation])
    np.testing.assert_allclose(R[0, 0], START.rotation, atol=1e-12)
    R, t = motion([10], [END, START]).at([0, 10, 20])
    np.testing.assert_allclose(t, [[END.translation, START.translation]] * 3)
    np.testing.assert_allclose(R[2, 0], END.rotation, atol=1e-12)


@pytest.mark.parametrize(
    ("stamps", "rows"), [([], []), ([1, 1], [[START], [END]]), ([2, 1], [[START], [END]]), ([1, 2], [[START]])]
)
def test_what_is_no_motion(stamps, rows):
    with pytest.raises(ValueError, match="motion"):
        motion(stamps, *rows)


def test_a_scan_is_straightened_to_any_moment():
    target_m = np.array([4.0, -1.0, 0.5])
    moving = motion([1000, 2000], [START], [END])
    R, t = moving.at([1000, 1400, 2000])
    seen = np.stack([R[i, 0].T @ (target_m - t[i, 0]) for i in range(3)])
    scan = LidarScan(
        stamp_ns=1000, seq=0, frame="lidar", points_m=seen, intensity=[1, 1, 1], t_ns=[0, 400, 1000], ring=[0, 0, 0]
    )
    np.testing.assert_allclose(deskewed(scan, moving), [START.inv().apply(target_m)] * 3, atol=1e-6)
    np.testing.assert_allclose(deskewed(scan, moving, at_ns=2000), [END.inv().apply(target_m)] * 3, atol=1e-6)
