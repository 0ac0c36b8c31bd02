"""Random numbers as a pure function of (seed, stream, counter): any one can be had without those before it.

Inlinable numba kernels. A stream is one kind of noise at one time; the counter goes through its pixels or rays. Use
`hash64` of seed, kind and stamp as the seed of a stream.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from shared.kernel import kernel

Seed = int | np.uint64

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1, _MIX_2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)

_SUBDIVISION_BITS = 6
"""Quantiles are tabled at 64 steps an octave of the tail's probability and linear in between."""
_SHIFT = np.int32(23 - _SUBDIVISION_BITS)
_NUM_OCTAVES = 31


def _quantiles() -> NDArray[np.float32]:
    """Of the standard normal distribution at p = t / 2^32, t each tabled number from 1 to 2^31: -6.2 to 0."""
    steps = np.arange((_NUM_OCTAVES << _SUBDIVISION_BITS) + 2)
    octave, step = steps >> _SUBDIVISION_BITS, steps & ((1 << _SUBDIVISION_BITS) - 1)
    t = np.ldexp(1.0 + step / (1 << _SUBDIVISION_BITS), octave)
    inv_cdf = NormalDist().inv_cdf
    return np.array([inv_cdf(min(p, 0.5)) for p in t / 2.0**32], dtype=np.float32)


_QUANTILES = _quantiles()
_BITS_OF_ONE = np.int32(0x3F800000)


@kernel(inline="always")
def _mix(z: np.uint64) -> np.uint64:
    """Finaliser of splitmix64 (Steele, Lea, Flood 2014; constants of Stafford's mix 13)."""
    z = (z ^ (z >> np.uint64(30))) * _MIX_1
    z = (z ^ (z >> np.uint64(27))) * _MIX_2
    return z ^ (z >> np.uint64(31))


@kernel()
def hash64(seed: Seed, stream: int, counter: int) -> np.uint64:
    """64 random bits."""
    base = _mix(_mix(np.uint64(seed) + _GOLDEN) + np.uint64(stream) * _GOLDEN)
    return _mix(base + (np.uint64(counter) + np.uint64(1)) * _GOLDEN)


@kernel()
def uniform_of(bits: np.uint64) -> np.float32:
    """A number within [0, 1) of the upper 24 bits."""
    return np.float32(np.int32(bits >> np.uint64(40))) * np.float32(2.0**-24)


@kernel()
def normal_of(bits: np.uint64) -> np.float32:
    """A standard normal number of the lower 32 bits, by the inverse of the distribution; within +-6.3.

    The table's step is even in the bits of the tail's probability as a float, so tails are as fine as the middle.
    """
    tail = np.float32(np.int32(bits & np.uint64(0x7FFFFFFF)) | np.int32(1))
    position = tail.view(np.int32) - _BITS_OF_ONE
    step = position >> _SHIFT
    share = np.float32(position - (step << _SHIFT)) * np.float32(2.0**-23 * 2**_SUBDIVISION_BITS)
    value: np.float32 = _QUANTILES[step] + share * (_QUANTILES[step + 1] - _QUANTILES[step])
    return -value if bits & np.uint64(0x80000000) else value


@kernel()
def uniform(seed: Seed, stream: int, counter: int) -> np.float32:
    """A number within [0, 1)."""
    return uniform_of(hash64(seed, stream, counter))


@kernel()
def normal(seed: Seed, stream: int, counter: int) -> np.float32:
    """A number of mean 0 and standard deviation 1."""
    return normal_of(hash64(seed, stream, counter))
