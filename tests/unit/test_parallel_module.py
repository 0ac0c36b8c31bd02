import numpy as np
import pytest
from hypothesis import given, strategies as st

from shared.robot.parallel_module import ModuleGeometry, pistons_from_platform, platform_from_pistons

UNEQUAL = ModuleGeometry(base_half_m=0.05, platform_half_m=0.04)
strokes = st.floats(0.19, 0.25)


@pytest.mark.parametrize(
    ("platform", "pistons"),
    [  # FACTS section 1, and an independent implementation
        ((0.22, 0.0), (0.22, 0.22)),
        ((0.22, 0.3), (0.231827692203, 0.208186857408)),
        ((0.20, -0.5), (0.180889267742, 0.219231713991)),
        ((0.24, 0.7), (0.265935113506, 0.214437695860)),
        ((0.215, np.pi / 4), (0.243566202369, 0.187082927238)),
        ((0.1925, -0.3), (0.180688024097, 0.204328618694)),
    ],
)
def test_known_modules(platform, pistons):
    np.testing.assert_allclose(pistons_from_platform(*platform), pistons, atol=1e-12)
    np.testing.assert_allclose(platform_from_pistons(*pistons), platform, atol=5e-11)


def test_known_pistons():
    np.testing.assert_allclose(platform_from_pistons(0.22, 0.20), (0.209996, 0.252685), atol=5e-7)


def test_the_tilt_inside_the_strokes_is_at_most_48_7_degrees():
    # FACTS section 1
    left, right = np.meshgrid(np.linspace(0.19, 0.25, 61), np.linspace(0.19, 0.25, 61))
    _, phi = platform_from_pistons(left, right)
    assert np.rad2deg(np.abs(phi)).max() == pytest.approx(48.7, abs=0.05)


@given(strokes, strokes, st.sampled_from([ModuleGeometry(), UNEQUAL]))
def test_pistons_come_back(left, right, geometry):
    platform = platform_from_pistons(left, right, geometry)
    np.testing.assert_allclose(pistons_from_platform(*platform, geometry), (left, right), atol=1e-12)


@given(st.floats(0.15, 0.3), st.floats(-1.2, 1.2), st.sampled_from([ModuleGeometry(), UNEQUAL]))
def test_platforms_come_back(y_m, phi_rad, geometry):
    pistons = pistons_from_platform(y_m, phi_rad, geometry)
    np.testing.assert_allclose(platform_from_pistons(*pistons, geometry), (y_m, phi_rad), atol=1e-12)


def by_cubic(left, right, geometry):
    """The papers' cubic in C = cos(phi), as FACTS section 1 has it; the smallest |phi| with y > 0."""
    b, p = geometry.base_half_m, geometry.platform_half_m
    S, K = (left**2 + right**2) / 2 - b**2 - p**2, ((left**2 - right**2) / (4 * p)) ** 2
    cosines = np.roots([-2 * b * p, -S, 2 * b * p, S - K])
    real = cosines.real[(np.abs(cosines.imag) < 1e-9) & (np.abs(cosines.real) < 1)]
    phi = np.sign(left - right) * np.arccos(real.max())
    return (left**2 - right**2) / (4 * p * np.sin(phi)), phi


@given(strokes, strokes, st.sampled_from([ModuleGeometry(), UNEQUAL]))
def test_it_is_the_root_of_the_cubic(left, right, geometry):
    if abs(left - right) > 1e-4:  # nearer to phi = 0 the cubic loses its digits
        platform = platform_from_pistons(left, right, geometry)
        np.testing.assert_allclose(platform, by_cubic(left, right, geometry), atol=1e-9)


def test_arrays_and_what_does_not_fit():
    y, phi = platform_from_pistons([[0.22, 0.5, 0.2], [-0.2, np.nan, 0.25]], [[0.22, 0.1, 0.0], [0.2, 0.2, 0.25]])
    np.testing.assert_array_equal(np.isnan(y), [[False, True, True], [True, True, False]])
    np.testing.assert_array_equal(np.isnan(phi), np.isnan(y))
    assert y[0, 0] == pytest.approx(0.22, abs=1e-15)
