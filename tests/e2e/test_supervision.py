"""What dies or freezes is started again and everything goes on; what always dies is given up."""

import re
import signal
import sys

import psutil
import pytest

from services.recorder.bag.recording import Recording
from shared.messaging.bus import is_reachable
from shared.messaging.channels import EVENTS, JOINTS_STATE, LEG_STATE, LIDAR_POINTS, MAP_CLOUD
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.runtime.exit_codes import Exit
from tests.e2e.conftest import ALL_SERVICES, wait_for_services
from tests.support.processes import hyrecro_command, run, service_command, started, wait_until

pytestmark = pytest.mark.e2e


@pytest.fixture
def bus(pipeline):
    with pipeline.bus() as session:
        yield session


def process_of(running, arguments):
    """The process that runs now; None while there is none."""
    for child in running.children():
        try:
            if " ".join(child.cmdline()[1:]).startswith(f"-m {arguments}"):
                return child
        except (psutil.NoSuchProcess, psutil.ZombieProcess):
            continue
    return None


def wait_for_another(running, arguments, process):
    def is_another():
        assert running.process.poll() is None, (running.directory / "stderr.txt").read_text()
        now = process_of(running, arguments)
        return now is not None and now.pid != process.pid

    wait_until(is_another, f"another {arguments}")


def wait_for_events(inbox, *patterns):
    """In any order."""
    awaited = set(patterns)

    def are_said():
        if (parcel := inbox.take(0.1)) is not None:
            text = decode(EVENTS.message, parcel.payload).text
            awaited.difference_update([pattern for pattern in awaited if re.search(pattern, text)])
        return not awaited

    wait_until(are_said, " and ".join(patterns))


def messages_of(inbox):
    return iter(lambda: inbox.take(0.0), None)


def test_killed_and_frozen_services_are_back_and_it_is_said(pipeline, bus):
    events = Inbox()
    bus.subscribe(EVENTS, events)
    mapper, lidar = (process_of(pipeline, name) for name in ("services.mapper", "services.sensors --sensor lidar"))
    mapper.send_signal(signal.SIGKILL)
    lidar.send_signal(signal.SIGSTOP)
    wait_for_events(
        events,
        r"^mapper was killed by SIGKILL; it is back after \d+\.\d s \(1 restart\)$",
        r"^lidar gave no sign of life for \d\.\d s; it is back after",
    )
    assert not lidar.is_running()
    assert "mapper was killed by SIGKILL, is started again now" in (pipeline.directory / "stderr.txt").read_text()
    wait_for_services(pipeline, ALL_SERVICES)
    scans = Inbox()
    bus.subscribe(LIDAR_POINTS, scans)
    wait_until(lambda: scans.take(0.1), "a scan")


def test_when_a_frozen_router_is_back_everything_is(pipeline, bus):
    events, joints = Inbox(), Inbox()
    bus.subscribe(EVENTS, events)
    bus.subscribe(JOINTS_STATE, joints)
    wait_until(lambda: joints.take(0.1), "a state")
    services = {child.pid for child in pipeline.children()}
    router = process_of(pipeline, "cli.main router")
    router.send_signal(signal.SIGSTOP)
    wait_for_another(pipeline, "cli.main router", router)
    wait_for_events(events, r"^router gave no sign of life for \d\.\d s; it is back after")
    assert bus.alive() >= ALL_SERVICES
    list(messages_of(joints))
    wait_until(lambda: joints.take(0.1), "a state after the router's return")
    assert bus.ask(LEG_STATE, LEG_STATE.message) is not None
    assert len(services - {child.pid for child in pipeline.children()}) == 1, "no service was restarted"


def test_a_late_joiner_gets_the_map_of_a_paused_simulation(pipeline, bus):
    wait_until(lambda: bus.ask(MAP_CLOUD, MAP_CLOUD.message), "a map")
    assert pipeline.hyrecro("sim", "pause").returncode == 0
    clouds = Inbox()
    with pipeline.bus() as late:
        late.subscribe(MAP_CLOUD, clouds)
        assert len(decode(MAP_CLOUD.message, wait_until(lambda: clouds.take(0.1), "the map").payload).points_m) > 1000
    assert pipeline.hyrecro("sim", "resume").returncode == 0


def test_a_restart_is_recorded_and_the_exit_code_tells_that_messages_are_missing(tmp_path):
    without = [part for name in ("lidar", "depth") for part in ("--set", f"sensors.{name}.enabled=false")]
    with started(hyrecro_command("up", *without), tmp_path / "up") as running:
        wait_for_services(running, ALL_SERVICES - {"lidar", "depth"})
        process_of(running, "cli.main router").send_signal(signal.SIGKILL)
        stderr = running.directory / "stderr.txt"
        wait_until(
            lambda: re.search("event .*router was killed by SIGKILL; it is back", stderr.read_text()), "the event"
        )
        assert running.stop(signal.SIGTERM) == Exit.PARTIAL
    (path,) = (tmp_path / "up").glob("*Z/run.mcap")
    texts = [event.text for event in Recording(path).messages(EVENTS) if event.source == "supervisor"]
    assert [text.partition(";")[0] for text in texts] == ["router was killed by SIGKILL"]


def test_a_service_that_always_dies_is_given_up_with_its_reason(tmp_path):
    method = tmp_path / "dying.py"
    method.write_text("import os\nprint('no memory for this', flush=True)\nos._exit(1)\n")
    with started(hyrecro_command("up", "--set", f"mapper.method={method}:Dying"), tmp_path / "up") as running:
        assert running.process.wait(120) == Exit.FAILED
        stderr = (running.directory / "stderr.txt").read_text()
        assert "hyrecro: mapper ended with exit code 1 (given up after 5 restarts)" in stderr
        assert "Traceback" not in stderr
        assert not is_reachable(running.endpoint), "the router has ended too"


def test_a_service_with_a_wrong_setting_is_given_up_at_once(tmp_path):
    method = tmp_path / "empty.py"
    method.write_text("")
    with started(hyrecro_command("up", "--set", f"mapper.method={method}:Missing"), tmp_path / "up") as running:
        assert running.process.wait(60) == Exit.FAILED
        stderr = (running.directory / "stderr.txt").read_text()
        assert f"hyrecro: mapper ended with exit code 2: {method}: holds no class 'Missing'" in stderr


def test_the_guard_of_a_container_does_the_same(tmp_path):
    with started(hyrecro_command("router"), tmp_path / "router") as router:
        command = service_command("shared.runtime.guard", str(tmp_path / "ready"), "services.evaluator")
        with started(command, tmp_path / "guard", router.endpoint) as guard:
            wait_for_services(guard, {"evaluator"})
            evaluator = process_of(guard, "services.evaluator")
            evaluator.send_signal(signal.SIGSTOP)
            wait_for_another(guard, "services.evaluator", evaluator)
            wait_until(lambda: "back after" in (guard.directory / "stderr.txt").read_text(), "the guard's word")
            assert guard.stop(signal.SIGTERM) == Exit.FINE


def test_a_guard_gives_up_with_its_services_exit_code(tmp_path):
    command = (sys.executable, "-m", "shared.runtime.guard", tmp_path / "ready")
    guard = run(*command, "services.evaluator", "--set", "sim.rate_hz=0")
    assert guard.returncode == Exit.USAGE
    assert re.search(
        r"given up: services\.evaluator .* ended with exit code 2: .*sim\.rate_hz: should be", guard.stderr
    )
    assert run(*command).returncode == Exit.USAGE
