"""The first process of a container says in a file whether its service, here a few lines of Python, does its work."""

import os
import signal
import sys

import psutil

from tests.support.processes import ROOT, wait_until

SERVICE = """
import pathlib, time
from shared.runtime.notify import Pulse

pulse, started, gate = Pulse.from_environment(), pathlib.Path("started"), pathlib.Path("gate")
while started.exists() and not gate.exists():
    time.sleep(0.01)
started.touch()
pulse.ready()
time.sleep(99)
"""


def test_the_file_is_there_and_new_while_the_service_does_its_work(tmp_path):
    ready, gate = tmp_path / "ready", tmp_path / "gate"
    (tmp_path / "service.py").write_text(SERVICE)
    command = [sys.executable, "-m", "shared.runtime.guard", str(ready), "service"]
    with psutil.Popen(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}) as guard:
        try:
            wait_until(ready.exists, "the service's word")
            guard.children()[0].kill()
            wait_until(lambda: not ready.exists(), "the guard's look at a dead service")
            wait_until(guard.children, "another service")
            assert not ready.exists(), "it waits at the gate"
            gate.touch()
            wait_until(ready.exists, "the service's return")
            os.utime(ready, (0, 0))
            wait_until(lambda: ready.stat().st_mtime > 0, "the guard's next look")
            guard.send_signal(signal.SIGTERM)
            assert guard.wait(20) == 0
            assert not ready.exists()
        finally:
            guard.kill()
