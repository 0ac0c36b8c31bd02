import numpy as np
import pytest

from services.sensors.noise import add_range_noise

RANGES_M = np.full((200, 300), 5.0, dtype=np.float32)


def test_it_is_gaussian_with_the_given_deviation():
    errors_m = add_range_noise(RANGES_M, 0.008, np.random.default_rng(1)) - 5.0
    assert errors_m.mean() == pytest.approx(0.0, abs=1e-4)
    assert errors_m.std() == pytest.approx(0.008, rel=0.02)
    assert np.mean(np.abs(errors_m) < 0.008) == pytest.approx(0.6827, abs=0.01)


def test_the_same_seed_gives_the_same_bytes():
    first, again, other = (add_range_noise(RANGES_M, 0.01, np.random.default_rng(seed)) for seed in (4, 4, 5))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()
    assert first.dtype == np.float32


def test_what_was_not_hit_stays_so_and_does_not_shift_the_rest():
    some_missed = RANGES_M.copy()
    some_missed[::2] = np.inf
    whole, partial = (add_range_noise(ranges, 0.01, np.random.default_rng(4)) for ranges in (RANGES_M, some_missed))
    assert np.isinf(partial[::2]).all()
    np.testing.assert_array_equal(partial[1::2], whole[1::2])


def test_no_noise_changes_nothing():
    np.testing.assert_array_equal(add_range_noise(RANGES_M, 0.0, np.random.default_rng(1)), RANGES_M)
