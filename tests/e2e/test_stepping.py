"""A running robot puts its feet where it is told to: by the hyrecro command and by the plain zenoh CLI."""

import json

import pytest

from shared.messaging.channels import FOOT_STATUS, LEG_STATE
from shared.messaging.messages import FootPhase, FootStatus, LegState
from tests.e2e.conftest import wait_for_services
from tests.support.processes import hyrecro_command, started, wait_until

pytestmark = pytest.mark.e2e


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """A robot of its own: where it stands is part of these tests."""
    with started(hyrecro_command("up"), tmp_path_factory.mktemp("stepping")) as running:
        wait_for_services(running, {"sim", "planner"})
        yield running


def status(robot):
    with robot.bus() as bus:
        return bus.ask(FOOT_STATUS, FootStatus)


def test_steps_by_command_and_by_zenoh_put_and_refusals_with_their_reason(robot):
    result = robot.hyrecro("robot", "step", "--point", "0", "-0.4", "10.1", "--normal", "0", "0", "1")
    assert (result.returncode, result.stdout) == (0, "foot B stands\n"), result.stderr
    assert status(robot).T_world_goal[:3] == pytest.approx([0, -0.4, 10.105], abs=1e-6)

    refused = robot.hyrecro("robot", "step", "--point", "0", "-0.4", "10.4", "--normal", "0", "0", "1")
    assert refused.returncode == 1
    assert "no flush steel there: the nearest steel is 300 mm from the sole" in refused.stderr
    wait_until(lambda: status(robot).phase is FootPhase.REFUSED, "the refusal on foot/status")

    target = {"foot": "A", "point_m": [0, -0.6, 10.1], "normal": [0, 0, 1]}
    put = robot.zenoh("put", "-k", "hyrecro/foot/target", "-v", json.dumps(target))
    assert put.returncode == 0, put.stderr
    done = wait_until(lambda: (s := status(robot)).phase is FootPhase.DONE and s, "foot A on its place")
    assert (done.foot.value, done.progress) == ("A", 1.0)
    assert done.T_world_goal[:3] == pytest.approx([0, -0.6, 10.105], abs=1e-6)
    with robot.bus() as bus:
        assert bus.ask(LEG_STATE, LegState).fixed_foot.value == "B"

    pose = [0, -0.55, 10.105, 0, 0, 0, 1]
    result = robot.hyrecro("robot", "step", "A", "--pose", *map(str, pose))
    assert result.returncode == 0, result.stderr
    assert status(robot).T_world_goal[:3] == pytest.approx(pose[:3], abs=1e-6)


@pytest.mark.parametrize("arguments", [[], ["--point", "0", "0", "0"], ["C", "--point", "0", "0", "0"]])
def test_half_a_target_is_wrong_usage(robot, arguments):
    assert robot.hyrecro("robot", "step", *arguments).returncode == 2
