import numpy as np
import pytest

from services.mapper.planes.growth import map_of_scans
from services.mapper.planes.refinement import refine, refine_run
from services.mapper.registration import RegistrationError
from shared.geometry import SE3
from shared.runtime.config import MapperConfig
from tests.support.box_scans import frame_of_bars, grid_of_rays, path, scan

POSES = path(8)


def rms_mm(poses):
    return 1e3 * np.sqrt(
        np.mean([np.sum((a.translation - b.translation) ** 2) for a, b in zip(poses, POSES, strict=True)])
    )


@pytest.fixture(scope="module")
def scans():
    return [scan(frame_of_bars(), T, grid_of_rays(), 0.005, seed=i) for i, T in enumerate(POSES)]


@pytest.fixture(scope="module")
def rough_poses():
    rng = np.random.default_rng(0)
    return [POSES[0]] + [T @ SE3.exp(np.append(rng.normal(0, 0.003, 3), rng.normal(0, 0.0015, 3))) for T in POSES[1:]]


def test_poses_of_another_method_are_improved(scans, rough_poses):
    patch_map = map_of_scans(scans, [T.matrix[:3] for T in rough_poses], MapperConfig())
    refined = refine(scans, rough_poses, patch_map)
    assert rms_mm(rough_poses) > 4.0
    assert rms_mm(refined.poses) < 0.8
    np.testing.assert_array_equal(refined.poses[0].matrix, POSES[0].matrix)
    assert refined.moved_m[0] == 0.0
    assert refined.moved_m.max() > 0.003


def test_scans_that_can_be_read_once_are_refined_in_one_pass(scans, rough_poses):
    patch_map = map_of_scans(iter(scans), [T.matrix[:3] for T in rough_poses], MapperConfig())
    refined = refine(iter(scans), rough_poses, patch_map)
    assert rms_mm(refined.poses) < 0.5 * rms_mm(rough_poses)


def test_exact_scans_at_true_poses_stay_where_they_are():
    exact = [scan(frame_of_bars(), T, grid_of_rays()) for T in POSES]
    patch_map = map_of_scans(exact, [T.matrix[:3] for T in POSES], MapperConfig(range_noise_m=0.002))
    assert rms_mm(refine(exact, POSES, patch_map).poses) < 0.05


def test_scans_without_points_stay_where_they_were(scans):
    with_empty = [*scans[:3], np.empty((0, 3), np.float32), *scans[4:]]
    patch_map = map_of_scans(with_empty, [T.matrix[:3] for T in POSES], MapperConfig())
    refined = refine(with_empty, POSES, patch_map)
    np.testing.assert_allclose(refined.poses[3].matrix, POSES[3].matrix, atol=1e-12)
    with pytest.raises(RegistrationError, match="no scan shows enough planes"):
        map_of_scans([with_empty[3]] * 2, [np.eye(3, 4)] * 2, MapperConfig())


def test_a_noisy_run_is_refined_in_a_map_made_anew(rough_poses):
    noisy = [scan(frame_of_bars(), T, grid_of_rays(), 0.03, seed=i) for i, T in enumerate(POSES)]
    patch_map = map_of_scans(noisy, [T.matrix[:3] for T in rough_poses], MapperConfig())
    refined = refine_run(noisy, rough_poses, patch_map, MapperConfig())
    assert rms_mm(refined.poses) < 4.0 < rms_mm(rough_poses)
    assert len(refined.moved_m) == len(POSES)
