import numpy as np
import pytest

from services.mapper.planes.association import room_for
from services.mapper.planes.gauss_newton import (
    ALPHA,
    NUM_COLUMNS,
    add_products,
    eliminate_patch,
    factorise,
    gauss_newton,
    normal_sums,
    patch_columns,
    pose_columns,
    solve_factorised,
    step_pose,
    tangents,
)
from services.mapper.planes.moments import add_point
from services.mapper.planes.patches import PatchArrays
from shared.geometry import SE3

PLANES = [([1, 0, 0.1], -2.0), ([0, 1, 0.2], -1.5), ([0.1, 0, 1], -1.0), ([-1, 0.3, 0], -1.2), ([0.2, -1, -0.4], -2.2)]


def scene(T_true, weight_m2=1e4, seed=0):
    """Five patches of exact points seen from a pose: patch arrays, and the association of 100 points on each."""
    rng = np.random.default_rng(seed)
    found = room_for(len(PLANES), 0)
    arrays = PatchArrays(np.zeros((5, 4)), np.zeros((5, 3)), np.zeros((5, 10)), np.zeros(5, np.int64))
    for j, (normal, d) in enumerate(PLANES):
        n = np.array(normal) / np.linalg.norm(normal)
        B = np.linalg.svd(n[np.newaxis])[2][1:]
        arrays.planes[j], arrays.origins[j] = np.append(n, d), -d * n
        on_plane = -d * n + rng.uniform(-0.5, 0.5, size=(100, 2)) @ B
        for p, seen in zip(on_plane, T_true.inv().apply(on_plane), strict=True):
            add_point(arrays.moments[j], *(p - arrays.origins[j]))
            add_point(found.moments[j], *seen)
        found.moments[j] *= weight_m2
        arrays.moments[j] *= weight_m2
        found.num_points[j], found.touched[j] = 100, j
    found.num_touched[0] = 5
    return arrays, found


def rows(T):
    return T.matrix[:3].copy()


def test_a_step_turns_and_moves_along_the_lidars_axes():
    T, twist = SE3.exp([0.3, 1.0, -2.0, 0.5, -0.7, 1.1]), np.array([0.1, -0.2, 0.05, 0.3, 0.1, -0.2])
    moved = rows(T)
    step_pose(moved, twist)
    expected = T @ SE3(SE3.exp(np.append(np.zeros(3), twist[3:])).rotation, twist[:3])
    np.testing.assert_allclose(moved, rows(expected), atol=1e-12)


def test_tangents_are_at_right_angles():
    for normal in np.vstack([np.eye(3), -np.eye(3), np.random.default_rng(0).normal(size=(20, 3))]):
        n, B = normal / np.linalg.norm(normal), np.empty((3, 2))
        tangents(n, B)
        np.testing.assert_allclose(np.column_stack([n, B]).T @ np.column_stack([n, B]), np.eye(3), atol=1e-12)


def test_the_jacobian_is_that_of_small_steps():
    T, plane, origin = rows(SE3.exp([0.3, 1.0, -2.0, 0.5, -0.7, 1.1])), np.array([0.6, 0.0, 0.8, -1.0]), np.ones(3)
    J, B = np.empty((4, NUM_COLUMNS)), np.empty((3, 2))
    tangents(plane[:3].copy(), B)
    pose_columns(T, plane, J)
    patch_columns(T, B, origin, J)
    h = 1e-6
    for k in range(9):
        moved, n, d = T.copy(), plane[:3].copy(), plane[3]
        if k < 6:
            step_pose(moved, h * np.eye(6)[k])
        elif k < 8:
            n = n + h * B[:, k - 6]
            d = d - h * B[:, k - 6] @ origin
        else:
            d = d + h
        alpha = np.append(moved[:, :3].T @ n, n @ moved[:, 3] + d)
        np.testing.assert_allclose((alpha - J[:, ALPHA]) / h, J[:, k], atol=1e-5)


def test_a_patch_is_eliminated_as_by_the_schur_complement():
    rng = np.random.default_rng(0)
    J, M, N = rng.normal(size=(4, NUM_COLUMNS)), np.zeros(10), np.zeros((NUM_COLUMNS, NUM_COLUMNS))
    for p in rng.normal(size=(30, 3)):
        add_point(M, *p)
    add_products(M, J, 0, np.empty_like(J), N)
    keep, gone = [*range(6), ALPHA], [6, 7, 8]
    expected = (
        N[np.ix_(keep, keep)] - N[np.ix_(keep, gone)] @ np.linalg.inv(N[np.ix_(gone, gone)]) @ N[np.ix_(gone, keep)]
    )
    eliminate_patch(N)
    np.testing.assert_allclose(N[np.ix_(keep, keep)], expected, atol=1e-8)


def test_linear_equations_are_solved():
    B = np.random.default_rng(0).normal(size=(12, 12))
    H, g = B @ B.T, np.arange(12.0)
    x, L = g.copy(), H.copy()
    factorise(L)
    solve_factorised(L, x)
    np.testing.assert_allclose(H @ x, g, atol=1e-8)


@pytest.mark.parametrize("is_joint", [False, True])
def test_the_pose_is_found_from_moments_alone(is_joint):
    T_true = SE3.exp([0.2, -0.1, 0.3, 0.4, -0.2, 0.6])
    arrays, found = scene(T_true)
    T = rows(T_true @ SE3.exp([0.03, -0.02, 0.01, 0.02, 0.03, -0.01]))
    steps = [gauss_newton(T, found, arrays, 3, is_joint, 0.0) for _ in range(8)]
    assert steps[-1] < 1e-8
    np.testing.assert_allclose(T, rows(T_true), atol=1e-7)


def test_free_patches_take_their_share_of_a_disagreement():
    """Map and scan are told the same number of times, so that the truth lies in the middle for each pair of planes."""
    arrays, found = scene(SE3.identity())
    arrays.planes[0, 3] += 0.002
    held, free = rows(SE3.identity()), rows(SE3.identity())
    for _ in range(8):
        gauss_newton(held, found, arrays, 3, False, 0.0)
        gauss_newton(free, found, arrays, 3, True, 0.0)
    assert 0.0 < np.linalg.norm(free[:, 3]) < 0.8 * np.linalg.norm(held[:, 3])


def test_patches_with_few_points_are_left_out_and_nothing_said_means_no_step():
    arrays, found = scene(SE3.identity())
    T = rows(SE3.trans(0.05))
    assert gauss_newton(T, found, arrays, 101, False, 0.0) == 0.0
    np.testing.assert_array_equal(T, rows(SE3.trans(0.05)))


def test_the_hessian_counts_each_point_once():
    T = SE3.exp([0.2, -0.1, 0.3, 0.4, -0.2, 0.6])
    arrays, found = scene(T, weight_m2=123.0)
    H = np.empty((6, 6))
    squares, num = normal_sums(rows(T), found, arrays.planes, H)
    normals = arrays.planes[:, :3] @ T.rotation
    np.testing.assert_allclose(H[:3, :3], 100.0 * normals.T @ normals, atol=1e-6)
    assert (num, squares) == (500, pytest.approx(0.0, abs=1e-9))
