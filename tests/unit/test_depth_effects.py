import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from services.sensors.depth.effects import StereoEffects
from services.sensors.depth.shadow import shade_row
from services.sensors.rays.interface import Hits
from shared.runtime.sensor_config import DepthConfig
from tests.support.camera_views import pinhole

CAMERA = pinhole(640, 480)
BASELINE_M = 0.05
FOCAL_BASELINE = CAMERA.fx * BASELINE_M  # 16.1 px m
IDEAL = {"preset": "ideal", "max_range_m": 60.0}


def effects(seed=1, camera=CAMERA, **given):
    return StereoEffects(DepthConfig.model_validate({**IDEAL, **given}), camera, seed)


def hits(depth_m, cos_incidence=None):
    depth_m = np.broadcast_to(np.asarray(depth_m, np.float32), (CAMERA.height, CAMERA.width)).copy()
    face = np.where(np.isinf(depth_m), -1, 0).astype(np.int32)
    cosines = np.ones_like(depth_m) if cos_incidence is None else np.broadcast_to(cos_incidence, depth_m.shape)
    return Hits(depth_m, face, np.ascontiguousarray(cosines, np.float32))


def measured(camera, depth_m, stamp_ns=0, **given):
    return camera.measure(hits(depth_m, **given), stamp_ns).astype(int)


def disparity_errors(camera, depth_m, stamp_ns=0):
    return 1000 * FOCAL_BASELINE / measured(camera, depth_m, stamp_ns) - FOCAL_BASELINE / depth_m


def images_of_errors(num, depth_m=1.5, **given):
    return np.array([disparity_errors(effects(seed, **given), depth_m, 1000 * seed) for seed in range(num)])


def correlation(errors, lag):
    along = (errors[:, :, lag:] * errors[:, :, :-lag]).mean(), (errors[:, lag:] * errors[:, :-lag]).mean()
    return np.array(along) / (errors**2).mean()


def test_without_errors_depths_are_rounded_to_whole_millimetres():
    depth_m = np.random.default_rng(1).uniform(0.06, 60.0, (CAMERA.height, CAMERA.width))
    depth_m[:, 100:200] = np.inf
    depth_mm = measured(effects(), depth_m)
    assert not depth_mm[:, 100:200].any()
    is_met = np.isfinite(depth_m)
    np.testing.assert_allclose(depth_mm[is_met], 1000 * depth_m[is_met], atol=0.5 + 0.01)


@pytest.mark.parametrize("kind", ["correlated_noise_px", "white_noise_px", "static_noise_px"])
def test_each_noise_has_its_standard_deviation_in_the_disparity(kind):
    errors = images_of_errors(6, depth_m=3.0, **{kind: 0.08})
    assert errors.std() == pytest.approx(0.08, rel=0.03)
    assert abs(errors.mean()) < 0.005


def test_the_variance_is_the_same_at_every_pixel():
    num = 150
    errors = np.array([disparity_errors(effects(seed, correlated_noise_px=0.1), 3.0)[:40, :40] for seed in range(num)])
    # Of a pixel's variance over n images the standard error is sqrt(2 / n); the mean over a knot's cell varies less.
    by_phase = (errors**2).mean(axis=0)
    assert by_phase.mean() == pytest.approx(0.01, rel=0.1)
    np.testing.assert_allclose(by_phase, 0.01, rtol=5.5 * np.sqrt(2 / num))


def test_neighbours_share_the_correlated_noise_and_not_the_white():
    shared = images_of_errors(6, correlated_noise_px=0.1)
    for lag, expected in ((4, 2**-0.25), (8, 0.5), (16, 2**-4)):
        np.testing.assert_allclose(correlation(shared, lag), expected, atol=0.05)
    np.testing.assert_allclose(correlation(images_of_errors(2, white_noise_px=0.1), 1), 0, atol=0.01)


def test_the_width_of_the_correlation_is_as_set():
    errors = images_of_errors(4, correlated_noise_px=0.1, correlation_px=3.5)
    assert (correlation(errors, 3) > 0.52).all()
    assert (correlation(errors, 4) < 0.48).all()


def test_the_datasheets_errors_are_correlated_as_on_a_real_unit():
    # FACTS of a D435 at 640 x 480: .82, .52, .12 at 4, 8, 16 px
    errors = images_of_errors(8, preset="datasheet", max_range_m=60.0, shadow=False)
    for lag, expected in ((4, 0.82), (8, 0.52), (16, 0.12)):
        np.testing.assert_allclose(correlation(errors, lag), expected, atol=0.1)
    assert errors.std() == pytest.approx(np.sqrt(0.1**2 + 0.02**2 + 0.04**2), rel=0.05)


def test_the_errors_of_depth_grow_with_its_square():
    depths_m = np.array([0.6, 1.0, 1.5, 2.0, 3.0, 4.0])
    camera = effects(preset="datasheet", max_range_m=60.0)
    sigmas_m = [(measured(camera, depth_m, 7)[:, 80:] / 1000 - depth_m).std() for depth_m in depths_m]
    exponent, log_scale = np.polyfit(np.log(depths_m), np.log(sigmas_m), 1)
    assert exponent == pytest.approx(2.0, abs=0.1)
    assert np.exp(log_scale) == pytest.approx(np.sqrt(0.012) / FOCAL_BASELINE, rel=0.1)


def test_static_noise_stays_and_the_others_change():
    static = effects(static_noise_px=0.1)
    assert (measured(static, 2.0, 0) == measured(static, 2.0, 1)).all()
    assert (measured(static, 2.0) != measured(effects(2, static_noise_px=0.1), 2.0)).mean() > 0.9
    for kind in ("correlated_noise_px", "white_noise_px"):
        changing = effects(**{kind: 0.1})
        first, second = (disparity_errors(changing, 2.0, stamp_ns) for stamp_ns in (0, 1))
        assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.1


def test_disparities_are_whole_quanta():
    depth_m = np.linspace(0.5, 5.0, CAMERA.width)
    depth_mm = measured(effects(disparity_quantum_px=0.25), depth_m)[0]
    quanta = np.rint(FOCAL_BASELINE / depth_m / 0.25)
    np.testing.assert_allclose(depth_mm, 1000 * FOCAL_BASELINE / (0.25 * quanta), atol=0.51)
    assert len(set(depth_mm)) < CAMERA.width / 4


def test_what_is_nearer_than_the_largest_disparity_is_not_matched():
    limit_m = FOCAL_BASELINE / 60
    assert (measured(effects(max_disparity_px=60.0), limit_m * 1.001) > 0).all()
    assert (measured(effects(max_disparity_px=60.0), limit_m * 0.999) == 0).all()
    assert (measured(effects(), limit_m * 0.999) > 0).all()


def test_the_range_is_cut_off_at_the_noisy_depth():
    ranges = {"min_range_m": 1.0, "max_range_m": 3.0, "correlated_noise_px": 0.1, "white_noise_px": 0.1}
    for limit_m in (1.0, 3.0):
        depth_mm = measured(effects(**ranges), limit_m)
        assert (depth_mm > 0).mean() == pytest.approx(0.5, abs=0.15)
        assert set(np.unique(depth_mm)) - {0} <= set(range(1000, 3001))
    for depth_m in (0.9, 3.6):
        assert not measured(effects(**ranges), depth_m).any()


def test_depths_that_a_pixel_does_not_hold_are_not_given():
    far = effects(max_range_m=65.535, correlated_noise_px=0.1)
    depth_mm = measured(far, 64.0)
    assert 0.1 < (depth_mm == 0).mean() < 0.9
    assert depth_mm[depth_mm > 0].min() > 10_000


STEP_AT = 320
STEP_M = np.where(np.arange(CAMERA.width) < STEP_AT, 3.0, 1.0)


def test_outlines_are_displaced_by_the_jitter_and_hold_together():
    images = [measured(effects(seed, edge_jitter_px=1.5), STEP_M) for seed in range(8)]
    outlines = np.array([(image == 3000).sum(axis=1) - STEP_AT for image in images])
    assert outlines.std() == pytest.approx(1.5, rel=0.15)
    assert abs(outlines.mean()) < 0.4
    assert set(np.unique(images)) == {1000, 3000}
    steps = np.abs(np.diff(outlines, axis=1))
    assert steps.mean() < 0.5  # rows apart share their displacement
    assert np.abs(outlines).max() <= 6


def test_jitter_leaves_surfaces_without_a_step_as_they_are():
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    depth_m = 1 / (1.0 + 0.001 * u - 0.0005 * v)
    with_jitter, without = (measured(effects(edge_jitter_px=px), depth_m) for px in (1.5, 0.0))
    assert (with_jitter == without).all()


def test_jitter_moves_outlines_and_nothing_within_them():
    u = np.arange(CAMERA.width)
    depth_m = np.where(u < STEP_AT, 2.0, 0.5) / (1.0 + 0.002 * u)
    with_jitter, without = (measured(effects(edge_jitter_px=px), depth_m) for px in (2.0, 0.0))
    is_moved = with_jitter != without
    assert is_moved.any()
    assert (np.abs(np.log(with_jitter / without))[is_moved] > 1.0).all()


def test_jitter_acts_up_and_down_too():
    outlines = measured(effects(edge_jitter_px=2.0), np.where(np.arange(480) < 240, 3.0, 1.0)[:, np.newaxis])
    assert ((outlines == 3000).sum(axis=0) - 240).std() == pytest.approx(2.0, rel=0.35)


@pytest.mark.parametrize("near_m", [0.4, 1.0, 2.5])
def test_the_shadow_is_left_of_what_is_near_and_as_wide_as_the_disparities_differ(near_m):
    far_m = 3.0
    depth_m = np.where(np.arange(CAMERA.width) < STEP_AT, far_m, near_m)
    (holes,) = np.nonzero(measured(effects(shadow=True), depth_m)[0] == 0)
    unseen = np.arange(CAMERA.width) - FOCAL_BASELINE / depth_m < -0.5  # left of the right imager's image
    holes = holes[~unseen[holes]]
    assert len(holes) == pytest.approx(FOCAL_BASELINE * (1 / near_m - 1 / far_m), abs=1)
    assert holes.tolist() == list(range(STEP_AT - len(holes), STEP_AT))


def test_right_of_what_is_near_there_is_no_shadow():
    assert (measured(effects(shadow=True), STEP_M[::-1])[:, 50:] > 0).all()


def test_the_left_margin_is_outside_of_the_right_imagers_view():
    depth_m = 0.5
    (holes,) = np.nonzero(measured(effects(shadow=True), depth_m)[7] == 0)
    assert len(holes) == pytest.approx(FOCAL_BASELINE / depth_m, abs=1)
    assert holes.tolist() == list(range(len(holes)))
    assert (measured(effects(shadow=False), depth_m) > 0).all()


def test_a_steep_wall_casts_no_shadow_on_itself():
    u = np.arange(CAMERA.width)
    for slope in (0.2, -0.2):  # of the disparity, a pixel: a wall seen from four baselines aside
        depth_m = FOCAL_BASELINE / (70 + slope * (u - 320))
        assert (measured(effects(shadow=True), depth_m)[0, 200:] > 0).all()


@settings(max_examples=200)
@given(
    pieces=st.lists(st.tuples(st.integers(1, 20), st.integers(0, 12)), min_size=1, max_size=12),
)
def test_shadows_are_those_of_a_search_over_all_pairs(pieces):
    disparity = np.concatenate([np.full(length, 3.0 * level) for length, level in pieces])
    u = np.arange(len(disparity))
    column = u - disparity
    is_behind = (column[:, np.newaxis] == column) & (disparity > disparity[:, np.newaxis] + 1)
    expected = np.where(is_behind.any(axis=1) | (column < 0), 0, disparity)
    shaded = disparity.astype(np.float32)
    shade_row(shaded, np.empty_like(shaded), np.empty(len(shaded), np.int32))
    np.testing.assert_array_equal(shaded, expected)


def share_of_holes(angles_deg, **given):
    cosines = np.cos(np.deg2rad(angles_deg))[np.newaxis, :]
    return (measured(effects(**given), 1.0, cos_incidence=cosines) == 0).mean(axis=0)


def test_holes_become_certain_over_the_fade():
    angles_deg = np.linspace(60, 89, CAMERA.width)
    share = share_of_holes(angles_deg, max_incidence_deg=75.0, incidence_fade_deg=10.0)
    expected = np.clip((angles_deg - 65) / 10, 0, 1)
    np.testing.assert_allclose(share, expected, atol=5 * 0.5 / np.sqrt(CAMERA.height))
    assert (share[expected == 0] == 0).all()
    assert (share[expected == 1] == 1).all()


def test_without_a_fade_holes_begin_at_once_and_at_90_degrees_there_are_none():
    angles_deg = np.linspace(60, 89.9, CAMERA.width)
    step = share_of_holes(angles_deg, max_incidence_deg=75.0, incidence_fade_deg=0.0)
    assert (step == (angles_deg > 75)).all()
    assert not share_of_holes(angles_deg, max_incidence_deg=90.0, incidence_fade_deg=20.0).any()


def test_the_same_seed_and_stamp_give_the_same_image():
    first, second = effects(5, preset="datasheet"), effects(5, preset="datasheet")
    measured(first, STEP_M, 3)
    images = [measured(each, STEP_M, 9, cos_incidence=0.3) for each in (first, second)]
    assert (images[0] == images[1]).all()
    assert (images[0] != measured(first, STEP_M, 10, cos_incidence=0.3)).any()
