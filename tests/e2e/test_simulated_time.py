"""A pipeline with physics: actuators, simulated time on command, and a fall that is said and recorded."""

import json

import pytest

from services.recorder.bag.recording import Recording
from shared.messaging.channels import ACTUATORS_STATE, CLOCK, EVENTS, LEG_STATE, SIM_CONTROL
from shared.messaging.messages import ActuatorState, Clock, Foot, LegState, Severity, SimControl
from tests.e2e.conftest import ALL_SERVICES, wait_for_services
from tests.support.processes import hyrecro_command, started, wait_until

pytestmark = pytest.mark.e2e


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    with started(hyrecro_command("up", "--set", "sim.mode=dynamic"), tmp_path_factory.mktemp("up")) as running:
        wait_for_services(running, ALL_SERVICES)
        yield running


def asked(pipeline, channel, kind):
    with pipeline.bus() as bus:
        return wait_until(lambda: bus.ask(channel, kind), f"an answer on {channel.key}")


def is_holding(pipeline, *feet):
    return asked(pipeline, LEG_STATE, LegState).holding == feet


def stamp_ns(pipeline):
    return asked(pipeline, CLOCK, Clock).stamp_ns


def back_at_the_start(pipeline):
    assert pipeline.hyrecro("sim", "resume").returncode == 0
    assert pipeline.hyrecro("sim", "reset").stdout == "accepted\n"
    wait_until(lambda: is_holding(pipeline, Foot.A), "foot A holding")


def test_actuators_by_zenoh_put(pipeline):
    back_at_the_start(pipeline)
    value = json.dumps({"names": ["th_a", "a1_l"], "positions": [0.2, 0.221], "duration_s": 1.0})
    assert pipeline.zenoh("put", "-k", "hyrecro/actuators/target", "-v", value).returncode == 0

    def has_arrived():
        positions = asked(pipeline, ACTUATORS_STATE, ActuatorState).positions
        return abs(positions[4] - 0.2) < 1e-3 and abs(positions[0] - 0.221) < 1e-4

    wait_until(has_arrived, "the actuators at their target")
    got = pipeline.zenoh("get", "-s", "hyrecro/actuators/target", "-v", '{"names": ["a1_l"], "positions": [0.3]}')
    assert "a1_l is 0.3 m, must be within 0.19..0.25 m" in got.stderr


def test_simulated_time_stands_still_and_goes_on_by_steps(pipeline):
    assert pipeline.zenoh("put", "-k", "hyrecro/sim/control", "-v", "pause").returncode == 0
    wait_until(lambda: asked(pipeline, CLOCK, Clock).real_time_factor == 0, "a pause")
    paused_ns = stamp_ns(pipeline)
    assert pipeline.hyrecro("sim", "step", "25").stdout == "accepted\n"
    wait_until(lambda: stamp_ns(pipeline) == paused_ns + 250_000_000, "25 periods")
    assert pipeline.hyrecro("sim", "resume").stdout == "accepted\n"
    wait_until(lambda: stamp_ns(pipeline) > paused_ns + 500_000_000, "time running")
    refused = pipeline.hyrecro("sim", "step")
    assert (refused.returncode, refused.stderr) == (
        1,
        "hyrecro: hyrecro/sim/control: step needs a paused simulation: send pause first\n",
    )


def test_the_pace_is_that_asked_for(pipeline):
    assert pipeline.hyrecro("sim", "speed", "3").returncode == 0
    wait_until(lambda: asked(pipeline, CLOCK, Clock).real_time_factor == 3, "the pace")
    assert pipeline.hyrecro("sim", "speed", "0").returncode == 1
    with pipeline.bus() as bus:
        bus.command(SIM_CONTROL, SimControl(real_time_factor=1.0, seed=4))


def test_a_fall_is_said_and_recorded_and_a_reset_mends_it(tmp_path):
    with started(hyrecro_command("up", "--set", "sim.mode=dynamic"), tmp_path) as running:
        wait_for_services(running, ALL_SERVICES)
        back_at_the_start(running)
        running.hyrecro("robot", "joints", "0.3", "0", "0", "0", "0", "0", "0", "0", "--duration", "1")
        start_ns = stamp_ns(running)
        wait_until(lambda: stamp_ns(running) > start_ns + 1_500_000_000, "the foot in the air")
        assert running.hyrecro("robot", "leg", "B").stdout == "accepted\n"
        wait_until(lambda: is_holding(running), "nothing holding")
        back_at_the_start(running)
        assert running.stop() == 130
    recording = Recording(tmp_path / "latest" / "run.mcap")
    texts = [event.text for event in recording.messages(EVENTS) if event.severity is Severity.ERROR]
    assert texts[-1] == "foot A is released; nothing holds the robot, it falls"
    holds = [state.holding for state in recording.messages(LEG_STATE)]
    assert () in holds
    assert holds[-1] == (Foot.A,)
