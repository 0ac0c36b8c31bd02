"""The bus over a real router in this process: delivery, kept messages, commands, namespaces, schemas."""

import subprocess
import sys
import threading
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from shared.errors import BusError, RefusedError
from shared.messaging.bus import Bus
from shared.messaging.channels import (
    DEPTH_POINTS,
    HEALTH,
    JOINTS_STATE,
    JOINTS_TARGET,
    LEG_STATE,
    LEG_TARGET,
    LIDAR_POINTS,
)
from shared.messaging.codec import decode, decode_command, encode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Foot, Health, JointTarget, LegState, LegTarget, LidarScan
from shared.messaging.router import open_router
from shared.runtime.config import BusConfig
from shared.runtime.shared_memory import mapped_segments
from tests.support.processes import ROOT, free_endpoint, wait_until

pytestmark = pytest.mark.e2e

POOL_BYTES = BusConfig().shared_memory_mib * 2**20


@pytest.fixture(scope="module")
def endpoint():
    address = free_endpoint()
    with open_router(address):
        yield address


@pytest.fixture
def buses(endpoint, request):
    """Two sessions in a namespace of this test's own."""
    config = BusConfig(endpoint=endpoint, namespace=request.node.name.split("[")[0])
    with Bus(config) as a, Bus(config) as b:
        yield a, b


def leg_state(seq, foot=Foot.A):
    pose = np.array([0, 0, 0, 0, 0, 0, 1.0])
    return LegState(stamp_ns=seq, seq=seq, frame="world", fixed_foot=foot, T_world_foot=pose)


def heartbeat(service):
    return Health(stamp_ns=0, seq=0, frame="", service=service, uptime_s=1.0, rss_bytes=1, busy_ratio=0.0, channels=())


def scan(seq, num_points):
    columns = {"points_m": np.zeros((num_points, 3)), "intensity": np.zeros(num_points)}
    columns |= {"t_ns": np.zeros(num_points), "ring": np.zeros(num_points)}
    return LidarScan(stamp_ns=seq, seq=seq, frame="lidar", **columns)


def wait_until_known(declaring, asking):
    """Returns when the other session sees a token, which was declared after everything else."""
    declaring.announce("known")
    wait_until(lambda: "known" in asking.alive(), "the token")


def connected(publishing, subscribing, channel, first):
    """An inbox in which the first message of the publisher has arrived."""
    inbox = Inbox(max_bytes=2**28)
    subscribing.subscribe(channel, inbox)
    publishing.advertise(channel)

    def has_arrived():
        publishing.publish(channel, first)
        return inbox.take(0.1)

    wait_until(has_arrived, f"the first message on {channel.key}")
    while inbox.take(0.2) is not None:
        pass
    return inbox


def test_messages_arrive_whole_in_order_and_with_their_schema(buses):
    a, b = buses
    inbox = connected(a, b, LEG_STATE, leg_state(0))
    for seq in range(1, 101):
        a.publish(LEG_STATE, leg_state(seq))
    parcels = [inbox.take(5.0) for _ in range(100)]
    received = [decode(LegState, parcel.payload, schema=parcel.schema) for parcel in parcels]
    assert [message.seq for message in received] == list(range(1, 101))
    assert {parcel.schema for parcel in parcels} == {"hyrecro.LegState/1"}


def test_bursts_of_large_scans_arrive_whole(buses):
    """A stream may drop where a hop stands still for long, so each burst is small enough for the queues of all hops."""
    a, b = buses
    inbox = connected(a, b, LIDAR_POINTS, scan(0, 10))
    for first in range(1, 21, 4):
        sent = [scan(seq, 65_536) for seq in range(first, first + 4)]
        for message in sent:
            a.publish(LIDAR_POINTS, message)
        parcels = [inbox.take(5.0) for _ in sent]
        assert None not in parcels
        assert [decode(LidarScan, parcel.payload) for parcel in parcels] == sent


@pytest.mark.parametrize("expression", ["leg/s$*", "leg/*", "**"])
def test_what_is_sent_on_an_expression_is_of_the_channel_that_it_reaches(buses, expression):
    """Or whoever sends on `leg/s$*`, `leg/$*e` ... would have as many inboxes and counters as he likes."""
    a, b = buses
    inbox = connected(a, b, LEG_STATE, leg_state(0))
    wild = replace(LEG_STATE, key=expression)
    a.advertise(wild)
    a.publish(wild, leg_state(1))
    assert inbox.take(5.0).key == LEG_STATE.key_expr


def test_a_late_joiner_asks_for_what_is_kept(buses):
    a, b = buses
    a.advertise(LEG_STATE)
    a.publish(LEG_STATE, leg_state(5, Foot.B))
    assert wait_until(lambda: b.ask(LEG_STATE, LegState), "an answer") == leg_state(5, Foot.B)
    inbox = Inbox()
    b.subscribe(LEG_STATE, inbox)
    parcel = inbox.take(5.0)
    assert parcel.is_replay
    assert decode(LegState, parcel.payload).fixed_foot is Foot.B


def test_a_late_joiner_gets_the_last_of_a_stream_too(buses):
    a, b = buses
    a.advertise(HEALTH.of("mapper"))
    a.publish(HEALTH.of("mapper"), heartbeat("mapper"))
    inbox = Inbox()
    b.subscribe(HEALTH, inbox)
    parcel = wait_until(lambda: inbox.take(1.0), "the last heartbeat")
    assert (parcel.key, parcel.is_replay) == (HEALTH.of("mapper").key_expr, True)
    assert inbox.take(0.2) is None


def test_what_was_said_while_the_router_was_away_is_had_when_it_is_back():
    config = BusConfig(endpoint=free_endpoint())
    inbox = Inbox()
    with ExitStack() as sessions:
        with open_router(config.endpoint):
            a, b = (sessions.enter_context(Bus(config)) for _ in range(2))
            b.subscribe(LEG_STATE, inbox)
            a.advertise(LEG_STATE)
            a.announce("sim")
            wait_until(lambda: b.alive() == {"sim"}, "the publisher")
        a.publish(LEG_STATE, leg_state(7, Foot.B))
        with open_router(config.endpoint):
            parcel = wait_until(lambda: inbox.take(1.0), "what was said")
            assert decode(LegState, parcel.payload) == leg_state(7, Foot.B)
            wait_until(lambda: b.alive() == {"sim"}, "the token")
            wait_until(lambda: a.is_wanted(LEG_STATE), "the subscription")
            a.publish(LEG_STATE, leg_state(8))
            assert decode(LegState, inbox.take(5.0).payload).seq == 8


@pytest.mark.parametrize(
    "channel", [DEPTH_POINTS, DEPTH_POINTS.of_sensor("depth_rear")], ids=lambda channel: channel.key
)
def test_a_publisher_sees_whether_anybody_wants_a_channel(endpoint, channel):
    config = BusConfig(endpoint=endpoint, namespace="wanted")
    with Bus(config) as sensor:
        assert sensor.is_wanted(channel) is False, "not advertised"
        sensor.advertise(channel)
        assert sensor.is_wanted(channel) is False
        with Bus(config) as viewer:
            viewer.subscribe(LIDAR_POINTS, Inbox())
            viewer.subscribe(channel, Inbox())
            wait_until(lambda: sensor.is_wanted(channel), "a subscriber")
        wait_until(lambda: not sensor.is_wanted(channel), "nobody")


def test_a_subscriber_that_was_there_first_is_seen_too(buses):
    sensor, viewer = buses
    viewer.subscribe(DEPTH_POINTS, Inbox())
    wait_until_known(viewer, sensor)
    sensor.advertise(DEPTH_POINTS)
    wait_until(lambda: sensor.is_wanted(DEPTH_POINTS), "the subscriber")
    assert not sensor.is_wanted(LIDAR_POINTS)


def test_nobody_answers_for_what_was_never_said(buses):
    a, b = buses
    a.advertise(JOINTS_STATE)
    assert b.ask(LEG_STATE, LegState, timeout_s=0.5) is None


@pytest.mark.parametrize("is_accepted", [True, False])
def test_a_command_is_answered(buses, is_accepted):
    robot, operator = buses
    inbox = Inbox()
    robot.subscribe(LEG_TARGET, inbox)
    wait_until_known(robot, operator)

    def answer():
        parcel = inbox.take(10.0)
        assert decode_command(LegTarget, parcel.payload) == LegTarget(foot=Foot.B)
        parcel.reply(is_accepted, "no steel there")

    thread = threading.Thread(target=answer)
    thread.start()
    if is_accepted:
        operator.command(LEG_TARGET, LegTarget(foot=Foot.B))
    else:
        with pytest.raises(RefusedError, match="no steel there"):
            operator.command(LEG_TARGET, LegTarget(foot=Foot.B))
    thread.join()
    assert not thread.is_alive()


def test_an_observer_sees_commands_and_leaves_the_answer_to_the_robot(buses):
    observer, operator = buses
    inbox = Inbox(max_bytes=2**20)
    observer.subscribe(LEG_TARGET, inbox, is_observer=True)
    wait_until_known(observer, operator)
    with pytest.raises(BusError, match="nobody answers"):
        operator.command(LEG_TARGET, LegTarget(foot=Foot.A), timeout_s=5.0)
    parcel = inbox.take(5.0)
    assert parcel is not None
    assert (parcel.reply, parcel.payload) == (None, encode(LegTarget(foot=Foot.A)))


def test_a_command_without_a_robot_says_so(buses):
    _, operator = buses
    with pytest.raises(BusError, match="nobody answers"):
        operator.command(JOINTS_TARGET, JointTarget(q=np.zeros(8)), timeout_s=0.5)


def test_namespaces_keep_robots_apart(endpoint):
    one, two = (BusConfig(endpoint=endpoint, namespace=name) for name in ("robot1", "fleet/robot2"))
    with Bus(one) as a, Bus(two) as b, Bus(two) as c:
        a.advertise(LEG_STATE)
        b.advertise(LEG_STATE)
        a.publish(LEG_STATE, leg_state(1, Foot.A))
        b.publish(LEG_STATE, leg_state(2, Foot.B))
        assert wait_until(lambda: c.ask(LEG_STATE, LegState), "an answer") == leg_state(2, Foot.B)
        a.announce("sim")
        b.announce("mapper")
        wait_until(c.alive, "a token")
        assert c.alive() == {"mapper"}


def test_no_router_is_one_clear_error():
    with pytest.raises(
        BusError, match=r"no router at tcp/127\.0\.0\.1:\d+ after 0\.2 s: start one with `hyrecro router`"
    ):
        Bus(BusConfig(endpoint=free_endpoint(), connect_timeout_s=0.2))


def test_a_taken_endpoint_is_one_clear_error(endpoint):
    with pytest.raises(BusError, match="cannot listen on"), open_router(endpoint):
        pass


def test_closing_twice_is_fine(endpoint):
    bus = Bus(BusConfig(endpoint=endpoint))
    bus.announce("somebody")
    bus.close()
    bus.close()
    with Bus(BusConfig(endpoint=endpoint)) as other:
        assert other.alive() == set(), "its token is gone"


def test_a_robot_hears_another_one_apart_from_itself(endpoint):
    configs = [BusConfig(endpoint=endpoint, namespace=name) for name in ("robot_a", "robot_b")]
    inbox = Inbox()
    with Bus(configs[0]) as a, Bus(configs[1]) as b:
        for bus, foot in ((a, Foot.A), (b, Foot.B)):
            bus.advertise(LEG_STATE)
            bus.publish(LEG_STATE, leg_state(1, foot))
        a.subscribe(LEG_STATE, inbox)
        a.subscribe(LEG_STATE.of_robot("robot_b"), inbox)
        parcels = [wait_until(lambda: inbox.take(0.1), "what was last said") for _ in range(2)]
    feet = {parcel.key: decode(LegState, parcel.payload).fixed_foot for parcel in parcels}
    assert feet == {"hyrecro/leg/state": Foot.A, "robot_b/hyrecro/leg/state": Foot.B}


def test_a_router_that_is_connected_and_hears_nothing_is_opened_anew(endpoint):
    config = BusConfig(endpoint=free_endpoint())
    with open_router(free_endpoint()) as alone:
        assert not any(alone.rejoin() for _ in range(4))
    far = free_endpoint()
    with (
        open_router(far) as other,
        open_router(config.endpoint, peers=[far]) as router,
        Bus(BusConfig(endpoint=far)) as robot,
        Bus(config) as base,
    ):
        robot.advertise(LEG_STATE)
        robot.publish(LEG_STATE, leg_state(1, Foot.B))
        assert wait_until(lambda: base.ask(LEG_STATE, LegState), "joined") == leg_state(1, Foot.B)
        assert not any(router.rejoin() for _ in range(4)), "it hears the other's token"
        other._token.undeclare()  # as after a cut that left the two half joined
        assert wait_until(router.rejoin, "opened anew")
        assert wait_until(lambda: base.ask(LEG_STATE, LegState), "joined again") == leg_state(1, Foot.B)


def test_routers_join_whichever_runs_first(endpoint):
    peers = [free_endpoint(), endpoint]
    config = BusConfig(endpoint=free_endpoint())
    with Bus(BusConfig(endpoint=endpoint)) as robot, open_router(config.endpoint, peers=peers), Bus(config) as base:
        robot.advertise(LEG_STATE)
        robot.publish(LEG_STATE, leg_state(1, Foot.B))
        assert wait_until(lambda: base.ask(LEG_STATE, LegState), "the other host") == leg_state(1, Foot.B)
        with open_router(peers[0]), Bus(BusConfig(endpoint=peers[0])) as late:
            assert wait_until(lambda: late.ask(LEG_STATE, LegState), "a router that came later") is not None


def test_the_shared_memory_of_a_killed_publisher_is_given_back(endpoint):
    def publisher():
        return subprocess.Popen([sys.executable, "-m", "tests.support.scan_publisher", endpoint], cwd=ROOT)

    def in_use():
        return {path for path in mapped_segments() if path.stat().st_size == POOL_BYTES and path.stat().st_blocks}

    inbox = Inbox(max_bytes=2**28)
    with Bus(BusConfig(endpoint=endpoint)) as bus:
        bus.subscribe(LIDAR_POINTS, inbox)
        others = in_use()
        for _ in range(3):
            with publisher() as killed:
                try:
                    wait_until(lambda: inbox.take(0.1), "a scan")
                    wait_until(lambda: len(in_use() - others) == 1, "one pool: the living publisher's", 10.0)
                finally:
                    killed.kill()
            while inbox.take(0.2) is not None:
                pass
        assert len(in_use() - others) == 1  # nobody has made another since
