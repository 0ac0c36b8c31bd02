import mmap
import os

import psutil
import pytest

from shared.runtime.process_load import ProcessLoad


def test_open_files_and_shared_memory_are_those_of_now():
    process = ProcessLoad()
    before = process.look()
    fd = os.memfd_create("a piece of shared memory")
    try:
        os.ftruncate(fd, 4 * 2**20)
        with mmap.mmap(fd, 4 * 2**20) as memory:
            memory.write(bytes([1]) * (4 * 2**20))
            after = process.look()
    finally:
        os.close(fd)
    assert after.num_open_files >= before.num_open_files + 1
    assert after.shared_memory_bytes - before.shared_memory_bytes == 4 * 2**20
    assert after.rss_bytes >= after.shared_memory_bytes
    assert after.num_threads >= 1
    assert after.cpu_ratio >= 0


def test_a_process_that_is_not_there():
    with pytest.raises(psutil.NoSuchProcess):
        ProcessLoad(2**22 + 1)
