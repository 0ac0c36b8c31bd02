"""What the quick start and the Python tutorial tell people to type, in that order, against a pipeline of its own."""

import json
import os
import shlex
import subprocess
import sys

import numpy as np
import pytest

from tests.e2e.conftest import ALL_SERVICES, wait_for_services
from tests.support.documents import commands, programs
from tests.support.processes import ROOT, hyrecro_command, run, started, wait_until

pytestmark = pytest.mark.e2e

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
REFUSED = "q1 is 9"
BLIND_AND_QUICK = ("sensors.lidar.enabled=false", "sensors.depth.enabled=false", "sim.real_time_factor=5")


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """A pipeline that nobody has commanded yet."""
    options = [part for setting in BLIND_AND_QUICK for part in ("--set", setting)]
    with started(hyrecro_command("up", *options), tmp_path_factory.mktemp("quick_start")) as running:
        wait_for_services(running, ALL_SERVICES - {"lidar", "depth"})
        yield running


def test_the_quick_start_does_what_it_says(fresh):
    move, look, too_far = commands("quick_start.md", "zenoh")
    assert typed(move, fresh).returncode == 0
    posture = json.loads(shlex.split(move)[-1])["q"]
    wait_until(lambda: np.allclose(joints_of(typed(look, fresh)), posture, atol=1e-6), "the posture of the put")
    assert REFUSED in typed(too_far, fresh).stderr
    look_at, up, *robot, look_again = commands("quick_start.md", "hyrecro")
    assert (up, look_at) == ("hyrecro up", look_again)
    joints, state, step = (fresh.hyrecro(*shlex.split(line)[1:]) for line in robot)
    assert joints.stdout == "accepted\n"
    assert "fixed foot  A" in state.stdout
    assert (step.returncode, step.stdout) == (0, "foot B stands\n"), step.stderr

    *rows, told, at_rest = (printed(program, fresh) for program in programs("tutorials/command_from_python.md"))
    assert [len(json.loads(row)) for row in rows] == [8]
    assert told.startswith("refused: ")
    assert REFUSED in told
    assert at_rest.startswith("at rest after ")


def joints_of(got):
    return json.loads(got.stdout)["q"]


def typed(line, running):
    """A command line of the documentation, at the endpoint of this test."""
    return run(*shlex.split(line.replace(DEFAULT_ENDPOINT, running.endpoint)))


def printed(program, running):
    """What a program of the documentation prints."""
    environment = {**os.environ, "HYRECRO_BUS__ENDPOINT": running.endpoint}
    command = [sys.executable, "-W", "error", "-c", program]
    ran = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    return ran.stdout
