from statistics import NormalDist

import numpy as np
import pytest

from services.sensors.noise_hash import hash64, normal, uniform
from shared.kernel import kernel

NUM = 400_000


@kernel()
def drawn(seed, stream, normals, uniforms):
    for i in range(len(normals)):
        normals[i] = normal(seed, stream, i)
        uniforms[i] = uniform(seed, stream, i)


def numbers(seed, stream, num=NUM):
    normals, uniforms = np.empty(num, np.float32), np.empty(num, np.float32)
    drawn(np.uint64(seed), stream, normals, uniforms)
    return normals.astype(float), uniforms.astype(float)


@pytest.mark.parametrize(("seed", "stream"), [(0, 0), (1, 0), (0, 1), (2**64 - 1, 4)])
def test_moments(seed, stream):
    normals, uniforms = numbers(seed, stream)
    five_sigma = 5 / np.sqrt(NUM)
    np.testing.assert_allclose(normals.mean(), 0, atol=five_sigma)
    np.testing.assert_allclose(normals.var(), 1, atol=np.sqrt(2) * five_sigma)
    np.testing.assert_allclose((normals**3).mean(), 0, atol=np.sqrt(15) * five_sigma)
    np.testing.assert_allclose((normals**4).mean(), 3, atol=np.sqrt(96) * five_sigma)
    np.testing.assert_allclose(uniforms.mean(), 0.5, atol=five_sigma / np.sqrt(12))
    np.testing.assert_allclose(uniforms.var(), 1 / 12, atol=five_sigma / np.sqrt(180))
    assert uniforms.min() >= 0
    assert uniforms.max() < 1


@pytest.mark.parametrize("limit", [-3.5, -2.5, -1.0, -0.1, 0.0, 0.1, 1.0, 2.5, 3.5])
def test_the_distribution_has_the_tails_of_a_normal_one(limit):
    normals, _ = numbers(7, 3, 4 * NUM)
    p = NormalDist().cdf(limit)
    assert (normals < limit).mean() == pytest.approx(p, abs=5 * np.sqrt(p * (1 - p) / len(normals)))


def test_the_distribution_function_is_met_everywhere():
    normals, uniforms = np.sort(numbers(11, 0)[0]), np.sort(numbers(11, 0)[1])
    shares = (np.arange(NUM) + 0.5) / NUM
    cdf = NormalDist().cdf
    distances = [abs(cdf(normals[i]) - shares[i]) for i in range(0, NUM, 97)]
    kolmogorov_1e_5 = 2.5 / np.sqrt(NUM)
    assert max(distances) < kolmogorov_1e_5
    assert np.abs(uniforms - shares).max() < kolmogorov_1e_5


@pytest.mark.parametrize("lag", [1, 2, 64, 1280])
def test_neighbours_are_independent(lag):
    for values in numbers(5, 2):
        assert abs(np.corrcoef(values[lag:], values[:-lag])[0, 1]) < 5 / np.sqrt(NUM)


def test_seeds_streams_and_the_two_kinds_are_independent():
    first, first_uniform = numbers(1, 1)
    for other in (numbers(1, 2)[0], numbers(2, 1)[0], numbers(2**63, 1)[0], first_uniform):
        assert abs(np.corrcoef(first, other)[0, 1]) < 5 / np.sqrt(NUM)
        assert abs(np.corrcoef(first**2, other**2)[0, 1]) < 5 / np.sqrt(NUM)


def test_any_number_can_be_had_without_those_before_it():
    normals, uniforms = numbers(3, 4, 1000)
    assert normal(np.uint64(3), 4, 777) == normals[777]
    assert uniform(np.uint64(3), 4, 777) == uniforms[777]


def test_no_two_of_many_are_the_same():
    bits = {int(hash64(seed, stream, i)) for seed in range(10) for stream in range(10) for i in range(100)}
    assert len(bits) == 10_000
    ones = np.mean([bin(each).count("1") for each in bits])
    assert ones == pytest.approx(32, abs=5 * 4 / 100)


def test_each_bit_of_the_input_flips_half_of_the_output():
    for k in range(0, 63, 7):
        flipped = [int(hash64(5, 6, i)) ^ int(hash64(5, 6, i ^ 1 << k)) for i in range(500)]
        assert np.mean([bin(each).count("1") for each in flipped]) == pytest.approx(32, abs=5 * 4 / np.sqrt(500))
