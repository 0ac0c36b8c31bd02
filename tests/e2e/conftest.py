import pytest

from shared.messaging.bus import is_reachable
from shared.messaging.channels import ALIVE
from tests.support.processes import Running, hyrecro_command, started, wait_until

ALL_SERVICES = {"recorder", "evaluator", "mapper", "lidar", "depth", "planner", "sim"}


def wait_for_services(running: Running, names: set[str]) -> None:
    def is_ready() -> bool:
        assert running.process.poll() is None, (running.directory / "stderr.txt").read_text()
        if not is_reachable(running.endpoint):
            return False
        with running.bus() as bus:
            return names <= bus.alive()

    wait_until(is_ready, f"{names} alive on {ALIVE}")


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    """A whole pipeline by the production command, shared by the tests of a module."""
    with started(hyrecro_command("up"), tmp_path_factory.mktemp("up")) as running:
        wait_for_services(running, ALL_SERVICES)
        yield running
