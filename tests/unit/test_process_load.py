import mmap
import os
import signal
import subprocess
import sys

import psutil
import pytest

from shared.runtime.process_load import ProcessLoad, is_at_work
from tests.support.processes import wait_until


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


@pytest.mark.parametrize(
    ("code", "signum", "expected"),
    [
        ("while True: pass", signal.SIGCONT, True),
        ("while True: pass", signal.SIGSTOP, False),
        ("import time; time.sleep(99)", signal.SIGCONT, False),
    ],
)
def test_who_runs_is_at_work_who_sleeps_or_is_stopped_is_not(code, signum, expected):
    with subprocess.Popen([sys.executable, "-c", code]) as child:
        try:
            child.send_signal(signum)
            wait_until(lambda: is_at_work(child.pid) is expected, "the state")
        finally:
            child.kill()
    assert not is_at_work(child.pid)


def test_a_process_that_is_not_there():
    with pytest.raises(psutil.NoSuchProcess):
        ProcessLoad(2**22 + 1)
