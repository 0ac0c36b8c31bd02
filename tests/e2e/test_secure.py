"""A whole line on a secure bus: it works, who may commands, and who may not reaches nobody."""

import json
from pathlib import Path

import psutil
import pytest

from bench.attacks import ATTEMPTS, Attackers, attacked, delete, listening, put, query
from shared.errors import BusError
from shared.messaging.bus import Bus, is_reachable
from shared.messaging.channels import LEG_TARGET, MAP_ODOMETRY, RECORDER_STATUS, ROBOT_STOP
from shared.messaging.messages import Foot, LegTarget, Odometry, RecorderStatus
from shared.runtime.config import BusConfig
from tests.e2e.conftest import ALL_SERVICES
from tests.support.processes import free_endpoint, hyrecro_command, run, started, wait_until

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(600)]

FEW = tuple(attempt for attempt in ATTEMPTS if attempt[1] in (LEG_TARGET.key_expr, ROBOT_STOP.key_expr))


class Line:
    """A running pipeline, and how a role reaches it."""

    def __init__(self, folder: Path) -> None:
        self.attackers = Attackers(folder / "certs")
        self.credentials = folder / "certs"
        self.endpoint = free_endpoint().replace("tcp/", "tls/")

    def bus(self, role):
        credentials = self.credentials / f"{role}.json5"
        return Bus(BusConfig(endpoint=self.endpoint, credentials=credentials, connect_timeout_s=2.0))

    def options(self, role):
        path = self.credentials / f"{role}.json5"
        return ["--set", f"bus.endpoint={self.endpoint}", "--set", f"bus.credentials={path}"]


@pytest.fixture(scope="module")
def line(tmp_path_factory):
    folder = tmp_path_factory.mktemp("secure")
    line = Line(folder)
    command = hyrecro_command("up", "--set", f"bus.credentials={line.credentials}")
    with started(command, folder / "up", line.endpoint) as running:
        wait_until(lambda: running.process.poll() is not None or is_reachable(line.endpoint), "the router")
        with line.bus("operator") as bus:
            wait_until(lambda: bus.alive() >= ALL_SERVICES, "every service, each with its own credential")
            line.process = running.process
            yield line


@pytest.fixture
def operator(line):
    with line.bus("operator") as bus:
        yield bus


def test_the_line_works_and_a_viewer_sees_it(line):
    with line.bus("viewer") as viewer:
        wait_until(lambda: viewer.ask(MAP_ODOMETRY, Odometry), "a pose from the mapper")
        status = wait_until(lambda: viewer.ask(RECORDER_STATUS, RecorderStatus), "the recorder")
        written = {count.key for count in status.channels if count.num_written}
        assert {"lidar/points", "depth/image", "tf"} <= written or wait_until(
            lambda: (
                {"lidar/points", "depth/image", "tf"}
                <= {count.key for count in viewer.ask(RECORDER_STATUS, RecorderStatus).channels if count.num_written}
            ),
            "what is recorded",
        )


def test_the_router_alone_listens(line):
    ports = listening(psutil.Process(line.process.pid))
    assert [port.rpartition(" ")[2] for port in ports] == [line.endpoint.removeprefix("tls/")]


def test_an_operator_commands_by_our_command_and_by_the_stock_one(line, operator):
    operator.command(LEG_TARGET, LegTarget(foot=Foot.A))
    ours = run("hyrecro", "robot", "leg", "A", *line.options("operator"))
    assert (ours.returncode, ours.stderr) == (0, "")
    profile, key = line.credentials / "operator.json5", LEG_TARGET.key_expr
    client = ("zenoh", "--config", profile, "--mode", "client", "--connect", line.endpoint)
    stock = run(*client, "get", "-s", key, "-v", "A", "--decoder", "json")
    assert (stock.returncode, "accepted" in stock.stdout) == (0, True), stock


def test_a_viewer_is_told_why_nobody_answers(line):
    refused = run("hyrecro", "robot", "leg", "A", *line.options("viewer"))
    assert refused.returncode == 1
    assert "nobody answers on hyrecro/leg/target" in refused.stderr
    assert "may this credential not command?" in refused.stderr


def test_who_shows_nothing_that_the_router_takes_is_told_so(line, tmp_path):
    others = Attackers(tmp_path / "certs")
    assert others is not None
    config = BusConfig(endpoint=line.endpoint, credentials=tmp_path / "certs", connect_timeout_s=1.0)
    with pytest.raises(BusError, match="the router refuses a certificate that has expired or is of another authority"):
        Bus(config)


def test_no_attempt_reaches_anyone_and_the_operators_do(line, operator):
    profile = json.loads((line.credentials / "operator.json5").read_text())
    own = tuple(attempt for attempt in FEW if attempt[0] is not delete)
    assert attacked("the operator", profile, operator, line.endpoint, own).num_counted > 0
    for kind, attacker in line.attackers.kinds().items():
        outcome = attacked(kind, attacker, operator, line.endpoint, FEW)
        assert (outcome.num_answered, outcome.num_counted) == (0, 0), outcome
        is_let_in = kind.startswith("a viewer")  # who may look: what they send is dropped by the router
        assert outcome.num_connected == (len(FEW) if is_let_in else 0), outcome
    assert {attempt[0] for attempt in FEW} == {put, delete, query}
