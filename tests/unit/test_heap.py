"""What the C library keeps of freed memory: in few heaps, and it goes back to the system."""

import ctypes
import subprocess
import sys

import psutil
import pytest

from shared.runtime.heap import give_back

NUM, SIZE = 4000, 20_000  # below what is mapped for itself
NUM_HEAPS = """
import ctypes, sys, threading
from shared.runtime.heap import share_arenas
if sys.argv[1] == "shared":
    share_arenas()
num = 12
together = threading.Barrier(num)
def use():
    kept = bytearray(20_000)
    together.wait()
threads = [threading.Thread(target=use) for _ in range(num)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
libc = ctypes.CDLL(None)
libc.fdopen.restype = ctypes.c_void_p
file = ctypes.c_void_p(libc.fdopen(1, b"w"))
libc.malloc_info(0, file)
libc.fflush(file)
"""

pytestmark = pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="the C library is another")


def num_heaps(how):
    """Of a process of its own whose threads all have memory at once."""
    run = subprocess.run([sys.executable, "-c", NUM_HEAPS, how], capture_output=True, text=True, check=True)
    return run.stdout.count("<heap nr=")


def test_threads_share_two_heaps():
    assert num_heaps("shared") <= 2 < num_heaps("by default")


def test_what_was_freed_below_something_in_use_is_given_back():
    process = psutil.Process()
    buffers = [bytearray(SIZE) for _ in range(NUM)]
    last = buffers[-1]
    del buffers[:-1]
    before = process.memory_info().rss
    give_back()
    assert before - process.memory_info().rss > 0.5 * NUM * SIZE
    assert len(last) == SIZE
