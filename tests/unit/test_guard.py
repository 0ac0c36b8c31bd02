"""The first process of a container says in a file whether its service, here a few lines of Python, does its work."""

import os
import signal
import subprocess
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
    with subprocess.Popen(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}) as guard:
        try:
            wait_until(ready.exists, "the service's word")
            (service,) = psutil.Process(guard.pid).children()
            service.kill()
            wait_until(lambda: not ready.exists(), "the guard's look; the next service waits at the gate")
            gate.touch()
            wait_until(ready.exists, "the service's return")
            os.utime(ready, (0, 0))
            wait_until(lambda: ready.stat().st_mtime > 0, "the guard's next look")
            guard.send_signal(signal.SIGTERM)
            assert guard.wait(20) == 128 + signal.SIGTERM, "as its service, which does not hear it"
            assert not ready.exists()
        finally:
            guard.kill()
