"""A bad subscriber beside good ones, over a real router: who is frozen harms nobody, and gets what it missed."""

import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace

import pytest

from bench.load_roles import lidar
from shared.messaging.bus import Bus
from shared.messaging.channels import JOINTS_STATE, LEG_STATE, LIDAR_POINTS
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Foot, JointState, LegState
from shared.messaging.sequence import SequenceCounter
from shared.runtime.config import BusConfig
from tests.e2e.test_bus import leg_state
from tests.support.examples import EXAMPLES
from tests.support.processes import ROOT, free_endpoint, hyrecro_command, started, wait_until

pytestmark = pytest.mark.e2e

_PERIOD_S = 0.01
"""Of what is published, as the simulation does; what is put all at once may be dropped at the source."""


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory):
    """Of a router in a process of its own: this one's threads shall not help it."""
    address = free_endpoint()
    with started(hyrecro_command("router", "--endpoint", address), tmp_path_factory.mktemp("router"), address):
        yield address


@contextmanager
def bystander(endpoint):
    """A process that subscribes to every stream, without shared memory, like one on another host."""
    command = [sys.executable, "-m", "bench.load_roles", "bystander", "--endpoint", endpoint, "--seconds", "0"]
    process = subprocess.Popen(
        [*command, "--shared-memory-mib", "0"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
    )
    try:
        assert process.stdout.readline() == "ready\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def test_a_frozen_subscriber_harms_no_other(endpoint):
    """Scans fill every queue on the way to it; what else their publisher says goes on to the other, all of it."""
    scan = lidar()[0].message
    state = next(example for example in EXAMPLES if isinstance(example, JointState))
    inbox = Inbox(max_bytes=2**28)
    config = BusConfig(endpoint=endpoint, connect_timeout_s=30)
    with bystander(endpoint) as frozen, Bus(config) as publisher, Bus(config) as good:
        for channel in (JOINTS_STATE, LEG_STATE, LIDAR_POINTS):
            publisher.advertise(channel)
        good.subscribe(JOINTS_STATE, inbox)
        good.subscribe(LEG_STATE, inbox)
        wait_until(lambda: publisher.is_wanted(JOINTS_STATE) and publisher.is_wanted(LIDAR_POINTS), "subscribers")
        good.announce("good")
        wait_until(lambda: "good" in publisher.alive(), "the other subscriber")
        frozen.send_signal(signal.SIGSTOP)
        for seq in range(200):
            publisher.publish(LIDAR_POINTS, replace(scan, seq=seq))
            publisher.publish(JOINTS_STATE, replace(state, seq=seq))
            publisher.publish(LEG_STATE, leg_state(seq))
            time.sleep(_PERIOD_S)
        counters = {JOINTS_STATE: SequenceCounter(), LEG_STATE: SequenceCounter()}
        while (parcel := inbox.take(1.0)) is not None:
            if not parcel.is_replay:
                counters[parcel.channel].add(decode(parcel.channel.message, parcel.payload).seq)
    assert {channel.key: (c.num_received, c.num_missed) for channel, c in counters.items()} == {
        JOINTS_STATE.key: (200, 0),
        LEG_STATE.key: (200, 0),
    }


def test_what_was_said_while_the_router_was_away_is_asked_for_again(tmp_path):
    endpoint = free_endpoint()
    config = BusConfig(endpoint=endpoint, connect_timeout_s=30)
    router = hyrecro_command("router", "--endpoint", endpoint)
    inbox = Inbox()
    with started(router, tmp_path / "first", endpoint) as first, Bus(config) as publisher, Bus(config) as subscriber:
        publisher.advertise(LEG_STATE)
        publisher.publish(LEG_STATE, leg_state(1, Foot.A))
        subscriber.subscribe(LEG_STATE, inbox)
        assert inbox.take(10.0).is_replay
        first.process.kill()
        first.process.wait()
        publisher.publish(LEG_STATE, leg_state(2, Foot.B))
        with started(router, tmp_path / "second", endpoint):
            again = wait_until(lambda: newest(inbox, Foot.B), "the kept message", 30.0)
            assert again.seq == 2


def newest(inbox, foot):
    while (parcel := inbox.take(0.1)) is not None:
        message = decode(LegState, parcel.payload)
        if message.fixed_foot is foot:
            return message
    return None
