"""People and programs command a running pipeline: the hyrecro command and the plain zenoh CLI."""

import json
import subprocess
from functools import partial

import numpy as np
import pytest

from shared.messaging.channels import (
    CHANNELS,
    EVENTS,
    HEALTH,
    JOINTS_TARGET,
    LEG_STATE,
    LIDAR_POINTS,
    ROBOT_DESCRIPTION,
    ROBOT_STOP,
    STRUCTURE_DESCRIPTION,
    TF,
)
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import (
    MAX_STAMP_NS,
    Event,
    Foot,
    Health,
    LegState,
    LidarScan,
    RobotDescription,
    StructureDescription,
    Transforms,
)
from tests.e2e.conftest import ALL_SERVICES
from tests.support.processes import BIN, free_endpoint, run, wait_until

pytestmark = pytest.mark.e2e

POSTURE = [-0.6, 0, 0.6, 0, 0, 0.6, 0, -0.6]
NO_PATIENCE = "bus.connect_timeout_s=0.2"
PATIENCE = "transport/link/tx/queue/congestion_control/drop/wait_before_drop:1000000"
"""A plain put is dropped after 1 ms on a full link; a burst of them waits a second instead."""


def fixed_foot(running):
    with running.bus() as bus:
        return bus.ask(LEG_STATE, LegState).fixed_foot


def is_at(running, posture):
    q = running.state()["q"]
    return max(abs(a - b) for a, b in zip(q, posture, strict=True)) < 1e-9


def test_state_tells_the_robot_and_who_is_alive(pipeline):
    state = pipeline.state()
    assert set(state["services"]) >= ALL_SERVICES
    assert len(state["q"]) == 8
    assert len(state["hip_xyz_quat_xyzw"]) == 7
    text = pipeline.hyrecro("robot", "state")
    assert text.returncode == 0
    assert "fixed foot" in text.stdout


def test_joints_by_zenoh_put_as_typed(pipeline):
    put = pipeline.zenoh("put", "-k", "hyrecro/joints/target", "-v", json.dumps({"q": POSTURE}))
    assert put.returncode == 0, put.stderr
    wait_until(lambda: is_at(pipeline, POSTURE), "the posture of the put")


def test_joints_by_the_hyrecro_command(pipeline):
    result = pipeline.hyrecro("robot", "joints", "-0.1", "0", "0", "0", "0", "0", "0", "0.1")
    assert (result.returncode, result.stdout) == (0, "accepted\n")
    wait_until(lambda: is_at(pipeline, [-0.1, 0, 0, 0, 0, 0, 0, 0.1]), "the posture of the command")


@pytest.mark.parametrize("foot", ["B", "A"])
def test_foot_by_zenoh_put_and_get(pipeline, foot):
    assert pipeline.zenoh("put", "-k", "hyrecro/leg/target", "-v", foot).returncode == 0
    wait_until(lambda: fixed_foot(pipeline) is Foot(foot), f"foot {foot} fixed")
    got = pipeline.zenoh("get", "-s", "hyrecro/leg/state", "--decoder", "msgpack")
    assert json.loads(got.stdout)["fixed_foot"] == foot


def test_foot_by_the_hyrecro_command(pipeline):
    assert pipeline.hyrecro("robot", "leg", "B").stdout == "accepted\n"
    assert fixed_foot(pipeline) is Foot.B
    assert pipeline.hyrecro("robot", "leg", "C").returncode == 2


def test_status_by_zenoh_subscribe(pipeline):
    command = [BIN / "zenoh", "--mode", "client", "--connect", pipeline.endpoint]
    arguments = ["subscribe", "-k", "hyrecro/map/status", "--decoder", "msgpack"]
    with subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, text=True) as process:
        status = json.loads(process.stdout.readline())
        process.terminate()
    assert status["method"] == "plane"
    assert status["scan_seq"] >= 0


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ('{"q": [3, 0, 0, 0, 0, 0, 0, 0]}', "q1"),
        ('{"q": [0, 0, 0]}', "8"),
        ('{"q": [0, 0, 0, 0, 0, NaN, 0, 0]}', "must be finite"),
        ('{"q": [0.1], "names": ["knee"]}', "knee"),
        ("rubbish", "list of numbers"),
    ],
)
def test_what_is_refused_says_why_in_the_reply_and_on_events(pipeline, value, reason):
    inbox = Inbox()
    with pipeline.bus() as bus:
        bus.subscribe(EVENTS, inbox)
        wait_until(lambda: "sim" in bus.alive(), "a connected listener")
        got = pipeline.zenoh("get", "-s", JOINTS_TARGET.key_expr, "-v", value)
        assert reason in got.stderr
        events = iter(lambda: decode(Event, inbox.take(timeout_s=10.0).payload), None)
        event = next(event for event in events if event.source == "sim")
    assert reason in event.text


def test_garbage_on_every_key_kills_nothing(pipeline):
    before = {health.service: health.uptime_s for health in healths(pipeline)}
    keys = {channel.of("sim").key_expr for channel in CHANNELS if channel.is_recorded and channel is not ROBOT_STOP}

    def put(keys):
        lines = [f"{key} {value}\n" for key in sorted(keys) for value in ("\x81\xa1q", "{", "x" * 5000)]
        result = pipeline.zenoh("--cfg", PATIENCE, "put", "--line", "{key} {value}", stdin="".join(lines))
        assert result.returncode == 0, result.stderr

    put(keys)

    def has_counted():
        by_service = {health.service: health for health in healths(pipeline)}
        refused = {count.key for count in by_service["recorder"].channels if count.num_refused}
        is_alive = all(by_service[name].uptime_s > before[name] for name in ALL_SERVICES)
        if missing := keys - refused:  # a plain put may be dropped on a busy machine, like any LATEST message
            put(missing)
        return is_alive and not missing

    wait_until(has_counted, "every service alive and every refusal counted by the recorder")


def test_well_formed_nonsense_kills_nothing(pipeline):
    nowhere = Transforms(
        stamp_ns=MAX_STAMP_NS, seq=0, frame="moon", parents=("moon",), children=("base",), T_parent_child=np.eye(7)[6:]
    )
    no_urdf = {"stamp_ns": 0, "seq": 0, "frame": "", "urdf": "<robot <"}
    empty = {"points_m": np.empty((0, 3)), "intensity": [], "t_ns": [], "ring": []}
    nonsense = {
        TF: nowhere,
        ROBOT_DESCRIPTION: RobotDescription(**no_urdf),
        STRUCTURE_DESCRIPTION: StructureDescription(**no_urdf),
        LIDAR_POINTS: LidarScan(stamp_ns=0, seq=10**12, frame="x", **empty),
    }
    before = {health.service: health.uptime_s for health in healths(pipeline)}
    with pipeline.bus() as bus:
        for channel, message in nonsense.items():
            bus.advertise(channel)
            bus.publish(channel, message)

    def has_refused():
        by_service = {health.service: health for health in healths(pipeline)}
        refused = {count.key for count in by_service["lidar"].channels if count.num_refused}
        keys = {channel.key_expr for channel in (ROBOT_DESCRIPTION, STRUCTURE_DESCRIPTION)}
        return keys <= refused and all(by_service[name].uptime_s > before[name] + 1 for name in ALL_SERVICES)

    assert wait_until(has_refused, "the descriptions refused by the lidar and every service alive")


def healths(running):
    """A heartbeat of every service. A started service has none to give before its first second is over."""
    with running.bus() as bus:
        return [
            wait_until(partial(bus.ask, HEALTH.of(name), Health), f"a heartbeat of {name}")
            for name in sorted(ALL_SERVICES)
        ]


def test_top_tells_every_service_and_channel(pipeline):
    result = pipeline.hyrecro("top", "--once", "--json")
    assert result.returncode == 0, result.stderr
    top = json.loads(result.stdout)
    services = {row["name"]: row for row in top["services"]}
    assert services.keys() == ALL_SERVICES | {"supervisor"}
    for row in services.values():
        assert row["state"] == "ready"
        assert row["rss_bytes"] > 10_000_000
        assert row["num_open_files"] > 0
        assert row["sent_hz"] > 0
    channels = {row["key"]: row for row in top["channels"]}
    assert channels["tf"]["publishers"] == ["sim"]
    assert channels["tf"]["rate_hz"] > 10
    assert channels["tf"]["bytes_per_s"] > 1000
    hearers = {hearer["service"]: hearer for hearer in channels["lidar/points"]["hearers"]}
    assert hearers.keys() >= {"mapper", "recorder"}
    assert hearers["recorder"]["wait_max_s"] is not None
    table = pipeline.hyrecro("top", "--once").stdout.splitlines()
    assert max(map(len, table)) <= 80
    assert any(line.startswith("lidar/points ") for line in table)


def test_top_without_a_router_says_so():
    result = run("hyrecro", "top", "--once", "--set", f"bus.endpoint={free_endpoint()}", "--set", NO_PATIENCE)
    assert result.returncode == 1
    assert "no router at tcp/127.0.0.1:" in result.stderr
