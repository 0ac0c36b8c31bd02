"""Each error of the LiDAR against its closed form; all have a switch and are off in the preset `ideal`."""

import numpy as np
import pytest

from services.sensors.lidar.effects import LidarEffects
from services.sensors.rays.interface import EdgeHits, Hits
from services.sensors.scene import scene_of
from shared.geometry import SE3
from shared.robot.description import Shape
from shared.solids import Box
from tests.support.sensing import beams, lidar_config

NUM_COLUMNS, NUM_RINGS = 512, 128
BEAMS = beams(NUM_COLUMNS, NUM_RINGS)
SCENE = scene_of([Shape("world", Box((1, 1, 1)), SE3.identity(), material=name) for name in ("steel", "paint")])
STEEL, PAINT = 0, 6
DATASHEET = {
    "range_noise_m": 0.007,
    "weak_range_noise_m": 0.05,
    "detection_range_m": 40.0,
    "surfaces": {
        "default": {"reflectivity": 0.1, "max_incidence_deg": 90.0},
        "steel": {"reflectivity": 0.4, "max_incidence_deg": 70.0},
    },
}


def effects(seed=1, **changes):
    return LidarEffects(lidar_config(truth=True, **changes), BEAMS, SCENE, slice(0), seed)


def hits(range_m, cosine=1.0, face=PAINT):
    shape = (NUM_COLUMNS, NUM_RINGS)
    return Hits(
        np.full(shape, range_m, dtype=np.float32),
        np.full(shape, face, dtype=np.int32),
        np.full(shape, cosine, dtype=np.float32),
    )


def measured(returns):
    return np.linalg.norm(returns.points_m.astype(np.float64), axis=1)


def one_edge(ranges_m, faces, cosines=None):
    """The beam of column 5 and ring 7 split into these sub-rays."""
    row = np.array([ranges_m], dtype=np.float32)
    cosines = np.ones_like(row) if cosines is None else np.array([cosines], dtype=np.float32)
    return EdgeHits(np.array([5 * NUM_RINGS + 7]), row, np.array([faces], dtype=np.int32), cosines)


def test_without_errors_a_point_is_where_the_beam_met():
    returns = effects().apply(hits(4.0), None, 0)
    np.testing.assert_allclose(measured(returns), 4.0, rtol=1e-6)
    expected = 4.0 * BEAMS.directions()[returns.column, returns.ring]
    np.testing.assert_allclose(returns.points_m, expected, atol=1e-6)
    assert len(returns.ring) == NUM_COLUMNS * NUM_RINGS
    np.testing.assert_array_equal(returns.true_range_m, 4.0)


@pytest.mark.parametrize("range_m", [2.0, 10.0, 20.0, 40.0])
def test_noise_grows_as_the_signal_fades(range_m):
    returns = effects(**DATASHEET, max_range_m=200.0).apply(hits(range_m), None, 0)
    strength = (40.0 / range_m) ** 2
    assert np.std(measured(returns) - range_m) == pytest.approx(np.hypot(0.007, 0.05 / np.sqrt(strength)), rel=0.02)
    assert np.mean(measured(returns)) == pytest.approx(range_m, abs=0.002)


def test_noise_goes_by_incidence_and_reflectivity_as_by_the_signal():
    bright = effects(**DATASHEET).apply(hits(20.0, cosine=0.5, face=STEEL), None, 0)
    strength = 0.4 * 0.5 / 0.1 * (40.0 / 20.0) ** 2
    assert np.std(measured(bright) - 20.0) == pytest.approx(np.hypot(0.007, 0.05 / np.sqrt(strength)), rel=0.02)


@pytest.mark.parametrize("range_m", [30.0, 36.0, 40.0, 44.0, 55.0])
def test_the_chance_of_a_return_follows_the_signal(range_m):
    changes = {**DATASHEET, "max_range_m": 200.0, "range_noise_m": 0.0, "weak_range_noise_m": 0.0}
    returns = effects(**changes, detection_steepness=4.0).apply(hits(range_m), None, 0)
    strength = (40.0 / range_m) ** 2
    expected = strength**4 / (1 + strength**4)
    assert len(returns.ring) / (NUM_COLUMNS * NUM_RINGS) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(("angle_deg", "expected"), [(0, 1), (59, 1), (62.5, 0.75), (67.5, 0.25), (70.1, 0), (89, 0)])
def test_steel_fades_at_grazing_incidence(angle_deg, expected):
    cosine = np.cos(np.deg2rad(angle_deg))
    surfaces = {"default": {"reflectivity": 1, "max_incidence_deg": 90}, "steel": DATASHEET["surfaces"]["steel"]}
    steel, paint = (
        effects(incidence_fade_deg=10, surfaces=surfaces).apply(hits(5.0, cosine, face), None, 0)
        for face in (STEEL, PAINT)
    )
    assert len(steel.ring) / (NUM_COLUMNS * NUM_RINGS) == pytest.approx(expected, abs=0.01)
    assert len(paint.ring) == NUM_COLUMNS * NUM_RINGS


def test_intensity_is_reflectivity_and_cosine():
    returns = effects(surfaces=DATASHEET["surfaces"]).apply(hits(5.0, 0.8, STEEL), None, 0)
    np.testing.assert_allclose(returns.intensity, 255 * 0.4 * 0.8, rtol=1e-6)


def test_ranges_are_multiples_of_the_quantum():
    returns = effects(range_noise_m=0.01, range_quantum_m=0.004).apply(hits(5.0), None, 0)
    steps = measured(returns) / 0.004
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    assert len(set(np.round(steps).tolist())) > 10


def test_what_is_too_near_or_too_far_is_not_reported():
    assert len(effects(min_range_m=0.3).apply(hits(0.29), None, 0).ring) == 0
    assert len(effects(max_range_m=10.0).apply(hits(10.01), None, 0).ring) == 0
    half = effects(max_range_m=10.0, range_noise_m=0.01).apply(hits(10.0), None, 0)
    assert len(half.ring) / (NUM_COLUMNS * NUM_RINGS) == pytest.approx(0.5, abs=0.01)


def test_noise_is_of_seed_stamp_and_beam_alone():
    def ranges(seed, stamp_ns, range_m=5.0):
        return measured(effects(seed, range_noise_m=0.01).apply(hits(range_m), None, stamp_ns)) - range_m

    np.testing.assert_array_equal(ranges(1, 0), ranges(1, 0))
    np.testing.assert_allclose(ranges(1, 0), ranges(1, 0, 7.0), atol=2e-6)
    for other in (ranges(2, 0), ranges(1, 100)):
        assert abs(np.corrcoef(ranges(1, 0), other)[0, 1]) < 0.02


@pytest.mark.parametrize("num_near", [1, 3, 6])
def test_surfaces_within_a_pulse_mix_by_their_signal(num_near):
    near_m, far_m = 5.0, 5.2
    edges = one_edge([near_m] * num_near + [far_m] * (7 - num_near), [PAINT] * num_near + [STEEL] * (7 - num_near))
    returns = effects(surfaces=DATASHEET["surfaces"], pulse_m=0.3).apply(hits(5.1), edges, 0)
    mixed = (returns.column == 5) & (returns.ring == 7)
    near, far = num_near * 0.1 / near_m**2, (7 - num_near) * 0.4 / far_m**2
    assert measured(returns)[mixed] == pytest.approx((near * near_m + far * far_m) / (near + far), rel=1e-5)
    assert returns.intensity[mixed] == pytest.approx(255 * (num_near * 0.1 + (7 - num_near) * 0.4) / 7, rel=1e-5)
    assert (returns.face[mixed], returns.true_range_m[mixed]) == (PAINT, near_m)
    np.testing.assert_allclose(measured(returns)[~mixed], 5.1, rtol=1e-6)


def test_of_surfaces_farther_apart_the_stronger_return_counts():
    for num_near, expected_m in ((4, 5.0), (1, 6.0)):
        edges = one_edge([5.0] * num_near + [6.0] * (7 - num_near), [PAINT] * 7)
        returns = effects(pulse_m=0.3).apply(hits(6.0), edges, 0)
        mixed = (returns.column == 5) & (returns.ring == 7)
        assert measured(returns)[mixed] == pytest.approx(expected_m, rel=1e-6)


def test_a_bar_beside_the_axis_returns_weakly_and_an_empty_beam_not():
    nothing = Hits(*(np.full((NUM_COLUMNS, NUM_RINGS), v, t) for v, t in ((np.inf, "f4"), (-1, "i4"), (0, "f4"))))
    edges = one_edge([np.inf] * 6 + [5.0], [-1] * 6 + [PAINT])
    returns = effects().apply(nothing, edges, 0)
    assert (returns.column.tolist(), returns.ring.tolist()) == ([5], [7])
    assert returns.intensity[0] == pytest.approx(255 / 7)
    assert len(effects().apply(nothing, one_edge([np.inf] * 7, [-1] * 7), 0).ring) == 0
