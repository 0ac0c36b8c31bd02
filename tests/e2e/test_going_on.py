"""Simulation, mapper and recorder are killed at once in a climb, and it goes on: the same robot, the same map."""

import subprocess

import pytest

from bench.faults import SERVICES, VICTIMS
from bench.faults_scoring import score_of
from shared.messaging.channels import EVENTS, JOINTS_STATE
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import JointState
from shared.runtime.config import CONFIGS_DIR
from tests.e2e.conftest import wait_for_services
from tests.e2e.test_supervision import process_of, wait_for_another
from tests.support.processes import BIN, ROOT, hyrecro_command, started, wait_until

pytestmark = pytest.mark.e2e

TRAJECTORY = CONFIGS_DIR / "trajectories" / "along_bar.csv"


@pytest.fixture(scope="module")
def climbed(tmp_path_factory):
    """The folder of the run, and what was said on `events`."""
    directory = tmp_path_factory.mktemp("going_on")
    events = Inbox()
    with started(hyrecro_command("up", "--set", "recorder.run=run"), directory) as running:
        wait_for_services(running, set(SERVICES))
        options = ["--steps", "20", "--set", f"bus.endpoint={running.endpoint}"]
        play = subprocess.Popen([BIN / "hyrecro", "robot", "play", TRAJECTORY, *options], cwd=ROOT)
        try:
            with running.bus() as bus:
                bus.subscribe(EVENTS, events)
                wait_until(lambda: bus.ask(JOINTS_STATE, JointState).dq.any(), "the robot moving")
                killed = {name: process_of(running, VICTIMS[name]) for name in ("sim", "mapper", "recorder")}
                for process in killed.values():
                    process.kill()
                for name, process in killed.items():
                    wait_for_another(running, VICTIMS[name], process)
                wait_until(lambda: set(SERVICES) <= bus.alive(), "all alive again")
                assert play.poll() is None, "the climb shall outlast the deaths"
                assert play.wait(240) == 0
        finally:
            play.kill()
        assert running.stop() == 3  # the recording lacks something
    said = [decode(EVENTS.message, parcel.payload) for parcel in iter(lambda: events.take(0.0), None)]
    return directory / "run", said


def test_each_says_that_it_goes_on(climbed):
    restored = {event.source: event.text for event in climbed[1] if event.text.startswith("restored")}
    assert "foot " in restored["sim"]
    assert "goes on in its map" in restored["mapper"]
    assert "goes on with run run in a new file" in restored["recorder"]


def test_the_trajectory_is_that_of_one_map_and_the_recording_says_what_it_lacks(climbed):
    score = score_of(climbed[0])
    assert score.num_poses > 50
    assert score.ate_rmse_m < 0.005
    assert score.num_files == 2
    assert score.num_missing > 0
    assert score.unbalanced == {}
