import numpy as np
import pytest

from services.mapper.planes.matcher import PlaneMatcher
from services.mapper.registration import RegistrationError
from shared.geometry import SE3
from shared.runtime.config import MapperConfig
from tests.support.box_scans import Box, frame_of_bars, grid_of_rays, path, scan

RAYS = grid_of_rays()
CONFIG = MapperConfig()


def error_m(a, b):
    return float(np.linalg.norm(a.translation - b.translation))


def started(boxes=None, sigma_m=0.005, config=CONFIG, T=None):
    matcher = PlaneMatcher(config)
    pose = T or SE3.identity()
    matcher.start(scan(boxes or frame_of_bars(), pose, RAYS, sigma_m, seed=100), pose)
    return matcher


def follow(matcher, boxes, poses, sigma_m, is_predicted=True):
    results = []
    for i, T in enumerate(poses[1:], 1):
        guess = poses[i - 1] @ SE3.exp([0.01, -0.01, 0.005, 0.01, 0.0, 0.01]) if not is_predicted else T
        results.append(matcher.align(scan(boxes, T, RAYS, sigma_m, seed=i), [guess, poses[i - 1]], 1.0))
        matcher.accept(results[-1].T_map_lidar)
    return results


@pytest.mark.parametrize(("sigma_m", "max_error_m"), [(0.002, 0.001), (0.008, 0.003), (0.03, 0.012)])
@pytest.mark.parametrize("T_odd", [SE3.identity(), SE3.exp([0.0, 0.0, 0.0, 0.3, -0.5, 0.4])], ids=["level", "odd"])
def test_a_path_is_tracked_whatever_the_bars_directions(T_odd, sigma_m, max_error_m):
    boxes, poses = frame_of_bars(T_odd), path(6)
    results = follow(started(boxes, sigma_m), boxes, poses, sigma_m)
    for T, result in zip(poses[1:], results, strict=True):
        assert error_m(result.T_map_lidar, T) < max_error_m
        assert (result.T_map_lidar.inv() @ T).angle_rad < np.radians(0.5)
        assert result.score > 0.75
        assert not result.is_suspect
        assert result.sigma_m == pytest.approx(sigma_m, rel=0.2)


def test_large_steps_are_found_without_a_prediction():
    boxes, poses = frame_of_bars(), path(5, step_rad=0.6)
    results = follow(started(boxes), boxes, poses, 0.005, is_predicted=False)
    assert max(error_m(r.T_map_lidar, T) for r, T in zip(results, poses[1:], strict=True)) < 0.004


def test_places_far_from_the_origin_are_as_good():
    far = SE3.trans(1e4, -2e4, 5e3)
    matcher = started(T=SE3.identity())
    there = PlaneMatcher(CONFIG)
    there.start(scan(frame_of_bars(), SE3.identity(), RAYS, 0.005, seed=100), far)
    points, T = scan(frame_of_bars(), path(2)[1], RAYS, 0.005, seed=1), path(2)[1]
    near_error = matcher.align(points, [T], 1.0).T_map_lidar.inv() @ T
    far_error = there.align(points, [far @ T], 1.0).T_map_lidar.inv() @ far @ T
    np.testing.assert_allclose(far_error.log(), near_error.log(), atol=1e-4)


def test_the_result_counts_points_and_its_hessian_is_that_of_their_normals():
    matcher, T = started(sigma_m=0.005), path(2)[1]
    points = scan(frame_of_bars(), T, RAYS, 0.005, seed=1)
    result = matcher.align(points, [T], 1.0)
    assert result.num_points == len(points)
    assert 0.5 * len(points) < result.num_inliers < len(points)
    assert np.trace(result.hessian[:3, :3]) == pytest.approx(result.num_inliers, rel=1e-6)
    assert 0.002**2 < result.fitness_m2 < 0.005**2
    np.testing.assert_allclose(result.hessian, result.hessian.T, atol=1e-6 * np.abs(result.hessian).max())


def test_a_plain_bar_leaves_the_direction_along_it_weak():
    bar, ground = Box(SE3.trans(0.0, 1.0, 0.0), (50.0, 0.1, 0.1)), Box(SE3.trans(0.0, 0.0, -1.0), (50.0, 50.0, 0.1))
    matcher = started([bar, ground])
    result = matcher.align(scan([bar, ground], SE3.identity(), RAYS, 0.005, seed=1), [SE3.identity()], 1.0)
    values, vectors = np.linalg.eigh(result.hessian[:3, :3])
    assert values[0] < 0.01 * values[1]
    assert abs(vectors[0, 0]) > 0.99


def test_another_place_is_said_not_to_fit():
    matcher = started()
    elsewhere = [
        Box(SE3.exp([0, 0, 0, 0.9, 0.5, 0]) @ SE3.trans(0.4, 0.7 * k - 1.2, 1.0), (0.1, 0.5, 0.08)) for k in range(3)
    ]
    result = matcher.align(scan(elsewhere, SE3.identity(), RAYS, 0.005), [SE3.identity()], 1.0)
    assert result.is_suspect or result.score < CONFIG.min_score


@pytest.mark.parametrize("shift_m", [0.06, 0.09, -0.12])
def test_a_guess_that_slipped_along_the_bars_is_put_right_or_said(shift_m):
    matcher, T = started(sigma_m=0.01), path(2)[1]
    points = scan(frame_of_bars(), T, RAYS, 0.01, seed=5)
    weak = np.linalg.eigh(matcher.align(points, [T], 1.0).hessian[:3, :3])[1][:, 0]
    result = matcher.align(points, [SE3.trans(*(shift_m * weak)) @ T], 1.0)
    assert error_m(result.T_map_lidar, T) < 0.01 or result.is_suspect


@pytest.mark.parametrize("num", [0, 1, 2, 30])
def test_scans_of_few_points_score_little_and_break_nothing(num):
    matcher = started()
    points = np.random.default_rng(num).normal(size=(num, 3)).astype(np.float32)
    result = matcher.align(points, [SE3.identity()], 4.0)
    assert result.score < CONFIG.min_score or result.is_suspect
    assert matcher.localise(points) is None or matcher.localise(points).is_suspect
    if num == 0:
        assert (result.score, result.num_points, result.fitness_m2) == (0.0, 0, None)
    with pytest.raises(RegistrationError, match=f"a scan of {num} points shows too few planes"):
        PlaneMatcher(CONFIG).start(points, SE3.identity())


def test_a_scan_is_found_anywhere_in_the_map_without_a_guess():
    boxes, poses = frame_of_bars(), path(5)
    matcher = started(boxes)
    follow(matcher, boxes, poses, 0.005)
    for T in (poses[0], poses[3]):
        result = matcher.localise(scan(boxes, T, RAYS, 0.005, seed=50))
        assert result is not None
        assert error_m(result.T_map_lidar, T) < 0.004
        assert (result.T_map_lidar.inv() @ T).angle_rad < np.radians(0.3)


def test_patches_keep_their_ids_and_face_the_sensor():
    boxes, poses = frame_of_bars(), path(4)
    matcher = started(boxes)
    before = matcher.patches
    follow(matcher, boxes, poses, 0.005)
    after, n = matcher.patches, len(before.ids)
    np.testing.assert_array_equal(after.ids[:n], before.ids)
    assert len(after.ids) >= n
    assert np.sum(after.planes[:n, :3] * before.planes[:, :3], axis=1).min() > 0.99
    np.testing.assert_allclose(np.linalg.norm(after.planes[:, :3], axis=1), 1.0, atol=1e-12)
    assert (before.planes[:, 3] > 0).all()  # all were seen from the origin
    assert np.abs(np.sum(after.planes[:, :3] * after.centres_m, axis=1) + after.planes[:, 3]).max() < 1e-9
    assert (after.num_points[:n] >= before.num_points).all()


def test_no_more_patches_are_kept_than_allowed():
    config = MapperConfig(max_planes=10)
    boxes, poses = frame_of_bars(), path(4)
    matcher = started(boxes, config=config)
    follow(matcher, boxes, poses, 0.005)
    assert len(matcher.patches.ids) == 10


def test_scan_to_scan_knows_only_the_last_scan():
    boxes, poses = frame_of_bars(), path(4)
    matcher = started(boxes, config=MapperConfig(scan_to="scan"))
    results = follow(matcher, boxes, poses, 0.005)
    assert error_m(results[-1].T_map_lidar, poses[-1]) < 0.01
    assert matcher.patches.num_points.sum() <= results[-1].num_points


def test_shuffled_and_thinned_scans_are_aligned_too():
    rng, T = np.random.default_rng(0), path(2)[1]
    matcher = started()
    points = scan(frame_of_bars(), T, RAYS, 0.005, seed=1)
    for changed in (rng.permutation(points), points[np.sort(rng.choice(len(points), len(points) // 5, replace=False))]):
        result = matcher.align(changed, [T @ SE3.exp([0.01, 0.01, 0, 0, 0, 0.01])], 1.0)
        assert error_m(result.T_map_lidar, T) < 0.005
        assert not result.is_suspect
