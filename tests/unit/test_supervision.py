"""One supervised process: a few lines of Python that end, freeze or go on as they are told. Times are told too."""

import os
import signal
from contextlib import contextmanager

import psutil
import pytest

from shared.runtime.restarts import PULSE_LIMIT_S
from shared.runtime.supervision import PatientClock, Supervised
from tests.support.processes import wait_until

LIVING = "import time; from shared.runtime.notify import Pulse; p = Pulse.from_environment(); p.ready(); time.sleep(99)"


@contextmanager
def supervised(code, **options):
    child = Supervised("child", ["-c", code], 0.0, **options)
    try:
        yield child
    finally:
        child.stop()


def step_until(child, is_so, now_s):
    comebacks = []

    def step():
        comebacks.extend(filter(None, [child.step(now_s)]))
        return is_so()

    wait_until(step, "the child")
    return comebacks


def test_a_killed_process_is_back():
    with supervised(LIVING) as child:
        assert step_until(child, lambda: child.is_ready, 1.0) == []
        first_pid = child.pid
        os.kill(first_pid, signal.SIGKILL)
        step_until(child, lambda: child.pid not in (None, first_pid), 2.0)
        assert not child.is_ready
        (comeback,) = step_until(child, lambda: child.is_ready, 5.0)
        assert comeback.text == "child was killed by SIGKILL; it is back after 4.0 s (1 restart)"
        assert child.num_restarts == 1


def test_a_frozen_process_is_killed_and_back():
    with supervised(LIVING) as child:
        step_until(child, lambda: child.is_ready, 0.0)
        first_pid = child.pid
        os.kill(first_pid, signal.SIGSTOP)
        wait_until(lambda: psutil.Process(first_pid).status() == psutil.STATUS_STOPPED, "the freeze")
        child.step(1.0)  # hears what was under way
        step_until(child, lambda: child.pid not in (None, first_pid), 1.1 + PULSE_LIMIT_S)
        (comeback,) = step_until(child, lambda: child.is_ready, 5.0)
        assert comeback.text.startswith("child gave no sign of life for ")
        with pytest.raises(ProcessLookupError):
            os.kill(first_pid, 0)


def test_what_always_ends_is_given_up_with_its_last_words(tmp_path):
    code = "import sys; print('warming up', flush=True); sys.exit('no magnets')"
    path = tmp_path / "logs" / "child.log"
    with supervised(code, log_path=path) as child:
        now_s = 0.0
        while child.failure is None:
            now_s += 0.5 if child.pid is None else 0.0
            child.step(now_s)
        assert child.num_restarts == 5
        assert child.failure.startswith(f"child ended with exit code 1 (given up after 5 restarts) (see {path}): ")
        assert child.failure.endswith("| warming up | no magnets")
        assert path.read_text().count("warming up") == 6
        assert child.step(now_s + 100) is None
        assert (child.pid, child.exit_code) == (None, 1)


def test_a_wrong_configuration_is_given_up_at_once_with_what_the_process_said():
    code = """
from shared.runtime.notify import Pulse
Pulse.from_environment().status("sim.rate_hz: must be above 0")
raise SystemExit(2)
"""
    with supervised(code) as child:
        step_until(child, lambda: child.failure, 0.0)
        assert child.failure == "child ended with exit code 2: sim.rate_hz: must be above 0"


def test_the_clock_counts_only_what_was_watched(monkeypatch):
    now_s = 100.0
    monkeypatch.setattr("time.monotonic", lambda: now_s)
    clock = PatientClock()
    now_s += 0.25
    assert clock.now_s() == 0.25
    now_s += 3600.0
    assert clock.now_s() == 0.75
