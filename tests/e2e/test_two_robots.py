"""Two robots in one world on one router: a simulation and a LiDAR each, by the shipped presets."""

from contextlib import ExitStack
from types import SimpleNamespace

import numpy as np
import pytest

from services.sensors.surroundings import MEMBERS_A_ROBOT
from shared.errors import BusError
from shared.messaging.bus import Bus
from shared.messaging.channels import JOINTS_STATE, JOINTS_TARGET, LIDAR_POINTS
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import JointState, JointTarget, LidarScan
from shared.messaging.router import open_router
from shared.runtime.config import BusConfig
from tests.support.processes import free_endpoint, hyrecro_command, run, service_command, started, wait_until

pytestmark = pytest.mark.e2e

NAMES = ("robot_a", "robot_b")
LIDAR = ("--sensor", "lidar", "--set", "sensors.lidar.truth=true")


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """Both robots' buses, by name, and where their router listens."""
    endpoint, folder = free_endpoint(), tmp_path_factory.mktemp("robots")
    with ExitStack() as stack:
        stack.enter_context(open_router(endpoint))
        buses = {name: stack.enter_context(Bus(BusConfig(endpoint=endpoint, namespace=name))) for name in NAMES}
        for name in NAMES:
            for service, options in (("sensors", LIDAR), ("sim", ())):
                command = service_command(f"services.{service}", "--config", name, *options)
                stack.enter_context(started(command, folder / name / service, endpoint))
        for name, bus in buses.items():
            wait_until(lambda bus=bus: {"lidar", "sim"} <= bus.alive(), f"lidar and sim of {name}")
        yield SimpleNamespace(endpoint=endpoint, **buses)


@pytest.fixture(scope="module")
def scans_of_a(robots):
    inbox = Inbox()
    robots.robot_a.subscribe(LIDAR_POINTS, inbox)
    return inbox


def joints(bus):
    return wait_until(lambda: bus.ask(JOINTS_STATE, JointState), "joints").q


def seen_of_b(inbox):
    """The points on B in the next scan of A that has any, (N, 3) in A's frame."""

    def points_m():
        parcel = inbox.take(1.0)
        if parcel is None:
            return []
        scan = decode(LidarScan, parcel.payload)
        return scan.points_m[scan.member >= MEMBERS_A_ROBOT].tolist()

    return np.array(wait_until(points_m, "a scan with B in it"))


def test_a_command_reaches_only_the_robot_it_is_for(robots):
    before = joints(robots.robot_a)
    target = joints(robots.robot_b).copy()
    target[7] += 0.3
    robots.robot_b.command(JOINTS_TARGET, JointTarget(q=target, duration_s=0.5))
    wait_until(lambda: np.allclose(joints(robots.robot_b), target, atol=1e-6), "B arrives")
    np.testing.assert_array_equal(joints(robots.robot_a), before)


def test_a_sees_b_and_follows_it_when_it_moves(robots, scans_of_a):
    def middle_m():
        return np.mean(seen_of_b(scans_of_a), axis=0)

    before_m = middle_m()
    assert 1.0 < np.linalg.norm(before_m) < 3.0, "1.9 m beside"
    target = joints(robots.robot_b).copy()
    target[2] += 1.2
    robots.robot_b.command(JOINTS_TARGET, JointTarget(q=target, duration_s=1.0))
    wait_until(lambda: np.linalg.norm(middle_m() - before_m) > 0.05, "the points on B move")


def test_a_robot_that_runs_is_not_started_again(robots, tmp_path):
    options = ["--set", f"bus.endpoint={robots.endpoint}", "--set", f"recorder.directory={tmp_path}"]
    again = run(*hyrecro_command("up", "--join", "--config", "robot_a"), *options)
    assert (again.returncode, again.stderr) == (
        1,
        "hyrecro: robot_a runs already: lidar, sim. Set another bus.namespace\n",
    )


def test_there_must_be_a_router_to_join(tmp_path):
    options = ["--set", f"bus.endpoint={free_endpoint()}", "--set", "bus.connect_timeout_s=0.2"]
    alone = run(*hyrecro_command("up", "--join"), *options, "--set", f"recorder.directory={tmp_path}")
    assert alone.returncode == 1
    assert "no router at tcp/127.0.0.1" in alone.stderr


def test_a_robot_without_the_name_hears_nobody(robots):
    with Bus(BusConfig(endpoint=robots.endpoint, namespace="robot_c")) as bus:
        assert bus.alive() == set()
        with pytest.raises(BusError, match="nobody answers"):
            bus.command(JOINTS_TARGET, JointTarget(q=np.zeros(8)), timeout_s=0.5)
