import numpy as np

from services.sim.encoders import Encoders
from shared.runtime.config import EncoderConfig

Q = np.linspace(-1.0, 1.0, 8)
ERRING = EncoderConfig(bias_rad=0.005, noise_rad=0.002, piston_bias_m=0.0005, piston_noise_m=0.0002)
PISTONS = [1, 6]
TURNS = [0, 2, 3, 4, 5, 7]


def test_without_errors_the_truth_is_read_exactly():
    np.testing.assert_array_equal(Encoders(EncoderConfig(), np.random.default_rng(1)).read(Q), Q)


def test_the_same_seed_reads_the_same():
    first, second = (Encoders(ERRING, np.random.default_rng(3)) for _ in range(2))
    for _ in range(3):
        np.testing.assert_array_equal(first.read(Q), second.read(Q))
    assert not np.array_equal(first.read(Q), Encoders(ERRING, np.random.default_rng(4)).read(Q))


def test_the_bias_stays_and_the_noise_does_not():
    encoders = Encoders(ERRING, np.random.default_rng(5))
    errors = np.array([encoders.read(Q) - Q for _ in range(4000)])
    np.testing.assert_allclose(errors.std(axis=0)[TURNS], 0.002, rtol=0.05)
    np.testing.assert_allclose(errors.std(axis=0)[PISTONS], 0.0002, rtol=0.05)
    biases = np.array([Encoders(ERRING, np.random.default_rng(i)).read(np.zeros(8)) for i in range(2000)])
    np.testing.assert_allclose(biases.std(axis=0)[TURNS], np.hypot(0.005, 0.002), rtol=0.06)
    np.testing.assert_allclose(biases.std(axis=0)[PISTONS], np.hypot(0.0005, 0.0002), rtol=0.06)
