"""The page in a real browser, on the real pipeline: sliders, feet, refusals, and all that halts the robot."""

import signal

import numpy as np
import pytest

from shared.messaging.channels import JOINTS_STATE, LEG_STATE, ROBOT_STOP, SIM_CONTROL
from shared.messaging.codec import decode, decode_command
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Foot, JointState, LegState, SimAction, SimControl, Stop
from tests.e2e.conftest import wait_for_services
from tests.support.browser import chromium, free_port, opened, press, set_joint, shows
from tests.support.processes import ROOT, hyrecro_command, run, started, wait_until

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(600)]

SERVICES = {"recorder", "evaluator", "mapper", "planner", "sim"}
NO_SENSORS = ("--set", "sensors.lidar.enabled=false", "--set", "sensors.depth.enabled=false")
FAR_DEG = "150"


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    command = hyrecro_command("up", *NO_SENSORS)
    with started(command, tmp_path_factory.mktemp("up")) as running:
        wait_for_services(running, SERVICES)
        yield running


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture
def teleop(pipeline, tmp_path, request):
    """The page's process; the robot stands at its start, at rest. Its parameter: more settings."""
    with pipeline.bus() as bus:
        bus.command(SIM_CONTROL, SimControl(action=SimAction.RESET))
    port = free_port()
    more = getattr(request, "param", ["teleop.silence_s=30"])
    settings = [part for setting in (f"teleop.port={port}", *more) for part in ("--set", setting)]
    command = hyrecro_command("teleop", *settings)
    with started(command, tmp_path / "teleop", pipeline.endpoint) as running:
        wait_for_services(running, {"teleop"})
        running.port = port
        yield running


def joints(pipeline):
    with pipeline.bus() as bus:
        return wait_until(lambda: bus.ask(JOINTS_STATE, JointState), "joint states")


def moves(pipeline):
    return bool(joints(pipeline).dq.any())


def rests(pipeline):
    """Where the joints are when nothing moves any more."""
    wait_until(lambda: not moves(pipeline), "the robot at rest")
    q = joints(pipeline).q
    stamp_ns = joints(pipeline).stamp_ns
    later = wait_until(
        lambda: (state := joints(pipeline)).stamp_ns > stamp_ns + 1_000_000_000 and state, "a second of simulated time"
    )
    np.testing.assert_array_equal(later.q, q)
    return q


def set_off(pipeline, page):
    """Tried again where a page that is still busy with its first picture did not answer, and was not believed."""

    def is_off():
        set_joint(page, 3, FAR_DEG)
        return any(moves(pipeline) for _ in range(30))

    wait_until(is_off, "a joint that moves")


def test_a_slider_moves_its_joint_and_no_other(pipeline, teleop, browser):
    page = opened(browser, teleop.port)
    thumb = page.get_by_role("slider").nth(3)
    thumb.focus()
    for _ in range(10):
        thumb.press("ArrowRight")
    wait_until(lambda: abs(joints(pipeline).q[3] - np.deg2rad(10)) < 1e-6, "q4 at 10 degrees")
    q = rests(pipeline)
    assert not np.delete(q, 3).any()
    shows(page, "q4 10.0 \u00b0")
    page.close()


def test_the_foot_changes_and_what_is_refused_is_shown_with_its_reason(pipeline, teleop, browser):
    page = opened(browser, teleop.port)
    shows(page, "foot B would hold")
    press(page, "B")

    def fixed_foot():
        with pipeline.bus() as bus:
            return bus.ask(LEG_STATE, LegState).fixed_foot

    wait_until(lambda: fixed_foot() is Foot.B, "foot B fixed")
    shows(page, "foot A would hold")
    page.get_by_role("tab", name="Run").click()
    press(page, "Step")
    shows(page, "hyrecro/sim/control: step needs a paused simulation: send pause first")
    page.close()


def test_stop_halts_every_joint_at_once(pipeline, teleop, browser):
    page = opened(browser, teleop.port)
    set_off(pipeline, page)
    inbox = Inbox(max_bytes=64 * 2**20)
    with pipeline.bus() as bus:
        for channel in (JOINTS_STATE, ROBOT_STOP):
            bus.subscribe(channel, inbox, is_observer=True)
        page.get_by_role("button", name="STOP").first.click()
        parcels = []
        wait_until(lambda: _drained(inbox, parcels) and _num_after_stop(parcels) > 50, "states after the stop")
    at = next(i for i, parcel in enumerate(parcels) if parcel.channel is ROBOT_STOP)
    assert decode_command(Stop, parcels[at].payload).text == "teleop, STOP was pressed"
    before, after = _states(parcels[:at]), _states(parcels[at:])
    assert before[-1].dq.any()
    still = next(i for i, state in enumerate(after) if not state.dq.any())
    assert after[still].stamp_ns - before[-1].stamp_ns <= 100_000_000
    for state in after[still:]:
        np.testing.assert_array_equal(state.q, after[still].q)
        assert not state.dq.any()
    shows(page, "the robot is stopped: teleop, STOP was pressed")
    page.close()


def test_escape_stops_in_a_field_and_outside(pipeline, teleop, browser):
    page = opened(browser, teleop.port)
    set_off(pipeline, page)
    page.keyboard.press("Escape")
    shows(page, "the robot is stopped: teleop, STOP was pressed")
    rests(pipeline)
    set_off(pipeline, page)
    page.mouse.click(50, 400)
    page.keyboard.press("Escape")
    shows(page, "the robot is stopped: teleop, Escape was pressed")
    rests(pipeline)
    page.close()


def test_closing_the_page_halts_the_robot(pipeline, teleop, browser):
    page = opened(browser, teleop.port)
    set_off(pipeline, page)
    page.close()
    assert rests(pipeline)[3] < np.deg2rad(float(FAR_DEG)) - 0.1


@pytest.mark.parametrize("teleop", [["teleop.silence_s=8", "teleop.speed_share=0.1"]], indirect=True)
def test_a_page_that_hangs_halts_the_robot(pipeline, teleop, browser):
    page = opened(browser, teleop.port)
    set_off(pipeline, page)
    page.evaluate("setTimeout(() => { const start = Date.now(); while (Date.now() - start < 25000); }, 0)")
    assert rests(pipeline)[3] < np.deg2rad(float(FAR_DEG)) - 0.1
    shows(page, "the robot is stopped: teleop, the page that commands does not answer")
    page.close()


def test_killing_the_pages_process_halts_the_robot(pipeline, teleop, browser):
    page = opened(browser, teleop.port)
    set_off(pipeline, page)
    teleop.process.send_signal(signal.SIGKILL)
    assert rests(pipeline)[3] < np.deg2rad(float(FAR_DEG)) - 0.1
    page.close()


def test_a_trajectory_runs_and_ends_with_the_page(pipeline, teleop, browser):
    page = opened(browser, teleop.port)
    page.get_by_role("tab", name="Run").click()
    press(page, "Run")
    wait_until(lambda: moves(pipeline), "the trajectory under way")
    (player,) = [child for child in teleop.children() if "services.player" in child.cmdline()]
    teleop.process.send_signal(signal.SIGKILL)
    wait_until(lambda: not player.is_running() or player.status() == "zombie", "the end of the player")
    rests(pipeline)
    page.close()


def test_two_pages_one_commands(pipeline, teleop, browser):
    first, second = opened(browser, teleop.port), opened(browser, teleop.port)
    shows(second, "You watch")
    set_joint(second, 3, FAR_DEG)
    shows(second, "only one page commands at a time: take control first")
    assert not moves(pipeline)
    press(second, "Take control")
    shows(second, "You command")
    shows(first, "You watch")
    second.close()
    first.close()


def test_a_port_that_is_taken_is_told(pipeline, teleop):
    second = run(
        "hyrecro", "teleop", "--set", f"teleop.port={teleop.port}", "--set", f"bus.endpoint={pipeline.endpoint}"
    )
    assert second.returncode == 1
    assert f"cannot listen on 127.0.0.1 port {teleop.port}: Address already in use" in second.stderr


def test_stop_by_command_and_by_zenoh(pipeline):
    assert pipeline.hyrecro("robot", "stop", "enough").stdout == "accepted\n"
    for value in ("0", "{", "\u00a1alto!"):
        assert pipeline.zenoh("put", "-k", "hyrecro/robot/stop", "-v", value).returncode == 0
    with started(
        hyrecro_command("robot", "play", ROOT / "configs/trajectories/climb.csv"),
        pipeline.directory / "play",
        pipeline.endpoint,
    ) as play:
        wait_until(lambda: moves(pipeline), "the climb")
        assert pipeline.zenoh("put", "-k", "hyrecro/robot/stop", "-v", "enough").returncode == 0
        assert play.process.wait(30) == 3
        assert "line 2: stopped: enough" in (play.directory / "stderr.txt").read_text()
    rests(pipeline)


def _drained(inbox, parcels):
    while (parcel := inbox.take(0.0)) is not None:
        parcels.append(parcel)
    return True


def _num_after_stop(parcels):
    at = [i for i, parcel in enumerate(parcels) if parcel.channel is ROBOT_STOP]
    return len(parcels) - at[0] if at else 0


def _states(parcels):
    return [decode(JointState, parcel.payload) for parcel in parcels if parcel.channel is JOINTS_STATE]
