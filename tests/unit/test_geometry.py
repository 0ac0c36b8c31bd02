import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from shared.geometry import SE3

metres = arrays(np.float64, 3, elements=st.floats(-100, 100))
unit_vectors = (
    arrays(np.float64, 3, elements=st.floats(-1, 1))
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)
transforms = st.builds(
    lambda axis, angle, t: SE3(SE3.exp([0, 0, 0, *(angle * axis)]).rotation, t),
    unit_vectors,
    st.floats(0, np.pi),
    metres,
)


def assert_same(T: SE3, other: SE3, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(T.matrix, other.matrix, rtol=0, atol=tolerance)


@given(transforms)
def test_the_inverse_undoes(T):
    assert_same(T @ T.inv(), SE3.identity())
    assert_same(T.inv() @ T, SE3.identity())


@given(transforms, transforms, transforms)
def test_composition_is_associative(T_a_b, T_b_c, T_c_d):
    assert_same((T_a_b @ T_b_c) @ T_c_d, T_a_b @ (T_b_c @ T_c_d))


@given(transforms, transforms, metres)
def test_composition_maps_points_one_after_the_other(T_a_b, T_b_c, p_c):
    np.testing.assert_allclose((T_a_b @ T_b_c).apply(p_c), T_a_b.apply(T_b_c.apply(p_c)), rtol=0, atol=1e-9)


@given(transforms)
def test_exp_undoes_log(T):
    assert_same(SE3.exp(T.log()), T)


@given(unit_vectors, st.floats(0, np.pi - 1e-3), metres)
def test_log_undoes_exp(axis, angle, v):
    twist = np.concatenate([v, angle * axis])
    np.testing.assert_allclose(SE3.exp(twist).log(), twist, rtol=0, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 0.9e-8, 1.1e-8, 3e-8, 1e-6, 0.99e-4, 1.01e-4, 1e-2])
def test_small_rotations_keep_their_digits(angle):
    twist = np.array([3.0, -2.0, 1.0, 0.6 * angle, 0.0, 0.8 * angle])
    np.testing.assert_allclose(SE3.exp(twist).log(), twist, rtol=0, atol=1e-13)


@given(transforms)
def test_quaternions_round_trip(T):
    assert_same(SE3.from_xyz_quat_xyzw(T.xyz_quat_xyzw), T)
    assert np.linalg.norm(T.quat_xyzw) == pytest.approx(1.0, abs=1e-15)
    assert T.quat_xyzw[3] >= 0


@pytest.mark.parametrize(("axis", "quaternion"), [("x", [1, 0, 0, 0]), ("y", [0, 1, 0, 0]), ("z", [0, 0, 1, 0])])
def test_half_turns_have_their_quaternion(axis, quaternion):
    np.testing.assert_allclose(np.abs(SE3.rot(axis, np.pi).quat_xyzw), quaternion, rtol=0, atol=1e-15)
    assert SE3.rot(axis, np.pi).angle_rad == pytest.approx(np.pi, abs=1e-15)


def test_coordinate_rotations_turn_to_the_left():
    x, y, z = np.eye(3)
    np.testing.assert_allclose(SE3.rot("x", np.pi / 2).apply(y), z, atol=1e-16)
    np.testing.assert_allclose(SE3.rot("y", np.pi / 2).apply(z), x, atol=1e-16)
    np.testing.assert_allclose(SE3.rot("z", np.pi / 2).apply(x), y, atol=1e-16)


def test_rpy_turns_about_fixed_axes_roll_first():
    T = SE3.from_rpy((np.pi / 2, np.pi / 2, np.pi / 2), (1, 2, 3))  # z rolls to -y, pitches to -y, yaws to x
    np.testing.assert_allclose(T.apply(np.array([0.0, 0.0, 1.0])), [2, 2, 3], atol=1e-15)
    np.testing.assert_allclose(T.apply(np.array([1.0, 0.0, 0.0])), [1, 2, 2], atol=1e-15)


def test_points_keep_shape_and_precision():
    points = np.array([[[1, 2, 3], [4, 5, 6]]], dtype=np.float32)
    moved = SE3.trans(x_m=1.0).apply(points)
    assert moved.dtype == np.float32
    np.testing.assert_array_equal(moved, points + np.float32([1, 0, 0]))


def test_projected_takes_the_nearest_rotation():
    drifted = SE3.rot("z", 0.3).matrix
    drifted[:3, :3] *= 1.01
    assert_same(SE3.projected(drifted), SE3.rot("z", 0.3), tolerance=1e-15)


@pytest.mark.parametrize(
    ("rotation", "translation", "reason"),
    [
        (np.eye(4), np.zeros(3), "got \\(4, 4\\)"),
        (np.eye(3), np.zeros(2), "and \\(2,\\)"),
        (np.eye(3), [0, np.nan, 0], "finite"),
        (np.diag([1, 1, -1]), np.zeros(3), "determinant"),
        (1.001 * np.eye(3), np.zeros(3), "orthonormal"),
    ],
)
def test_what_is_no_rigid_transform_is_refused(rotation, translation, reason):
    with pytest.raises(ValueError, match=reason):
        SE3(rotation, translation)


@pytest.mark.parametrize(
    "pose", [[0, 0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0, 1.01], [0, 0, 0, 0, 0, 0, np.nan], [0, 0, 0]]
)
def test_what_is_no_pose_is_refused(pose):
    with pytest.raises(ValueError, match=r"quaternion length|must be"):
        SE3.from_xyz_quat_xyzw(pose)


def test_values_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        SE3.identity().translation[0] = 1.0


@given(*[st.one_of(st.floats(-np.pi, np.pi), st.sampled_from([np.pi / 2, -np.pi / 2, np.pi, 1.57]))] * 3)
def test_roll_pitch_yaw_are_read_back_also_at_the_poles(roll, pitch, yaw):
    T = SE3.from_rpy([roll, pitch, yaw])
    np.testing.assert_allclose(SE3.from_rpy(T.rpy_rad).rotation, T.rotation, rtol=0, atol=1e-14)


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_a_frame_from_its_z_axis(z_axis):
    T = SE3.from_z_axis(z_axis, (1, 2, 3))
    np.testing.assert_allclose(T.rotation[:, 2], np.array(z_axis) / np.linalg.norm(z_axis), atol=1e-12)
    np.testing.assert_array_equal(T.translation, [1, 2, 3])


def test_a_frame_from_its_z_axis_keeps_x_if_it_can():
    np.testing.assert_array_equal(SE3.from_z_axis((0, 0, 2)).rotation, np.eye(3))
    np.testing.assert_array_equal(SE3.from_z_axis((-1, 0, 0)).rotation[:, 0], [0, 1, 0])
    with pytest.raises(ValueError, match="length 0"):
        SE3.from_z_axis((0, 0, 0))
