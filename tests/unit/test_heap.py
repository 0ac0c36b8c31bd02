"""Freed memory that the C library keeps goes back to the system."""

import ctypes

import psutil
import pytest

from shared.runtime.heap import give_back

NUM, SIZE = 4000, 20_000  # below what is mapped for itself


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="the C library has no malloc_trim")
def test_what_was_freed_below_something_in_use_is_given_back():
    process = psutil.Process()
    buffers = [bytearray(SIZE) for _ in range(NUM)]
    last = buffers[-1]
    del buffers[:-1]
    before = process.memory_info().rss
    give_back()
    assert before - process.memory_info().rss > 0.5 * NUM * SIZE
    assert len(last) == SIZE
