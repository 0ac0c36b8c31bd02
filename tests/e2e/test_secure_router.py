"""The secure router between sessions of every role: what the wiring says is let through, and nothing else."""

import contextlib

import pytest

from cli.certificates import Authority, credential_files, now_utc
from cli.certs_commands import write_files
from shared.messaging.bus import Bus
from shared.messaging.channels import CHANNELS, HEALTH
from shared.messaging.inbox import Inbox
from shared.messaging.router import open_router
from shared.runtime.config import BusConfig
from shared.runtime.roles import OPERATOR, ROLES, VIEWER
from tests.support.examples import EXAMPLES
from tests.support.processes import free_endpoint, wait_until
from tools.docs.wiring import PEOPLE, all_wires

pytestmark = pytest.mark.e2e

WIRES = {wired.name if wired.name != PEOPLE else OPERATOR: wired for wired in all_wires()}
CHANNEL = {channel.key: channel for channel in CHANNELS}
READERS = (OPERATOR, VIEWER)


def keys_sent(role):
    """What a role says; health is checked apart, and a viewer's events are let through by nobody."""
    return sorted(WIRES[role].sends - {HEALTH.key} - ({"events"} if role == VIEWER else set()))


def takers(key):
    everyone = {role for role, wired in WIRES.items() if key in wired.takes}
    return everyone | (set() if CHANNEL[key].is_command else set(READERS))


def example(channel):
    return next(message for message in EXAMPLES if type(message) is channel.message)


@pytest.fixture(scope="module")
def roles(tmp_path_factory):
    """A session and an inbox a role, each subscribed to what it takes; who reads, to everything that is measured."""
    folder = tmp_path_factory.mktemp("router") / "certs"
    write_files(folder, credential_files(Authority(now_utc(), now_utc().replace(year=2100)), ROLES))
    config = BusConfig(endpoint=free_endpoint().replace("tcp/", "tls/"), credentials=folder)
    with contextlib.ExitStack() as stack:
        stack.enter_context(open_router(config.endpoint, credentials=folder))
        sessions = {role: (stack.enter_context(Bus(config, name=role)), Inbox()) for role in ROLES}
        for role, (bus, inbox) in sessions.items():
            for channel in CHANNELS:
                if role in takers(channel.key):
                    bus.subscribe(channel, inbox, is_observer=role == "recorder")
            for key in keys_sent(role):
                bus.advertise(CHANNEL[key])
            bus.advertise(HEALTH.of(role))
            bus.announce(role)
        yield sessions


def heard(inbox):
    return [parcel for parcel in iter(lambda: inbox.take(0.0), None) if not parcel.is_replay]


@pytest.mark.parametrize("sender", [role for role in ROLES if role != VIEWER])
def test_what_a_role_sends_reaches_all_who_take_it(roles, sender):
    bus, _ = roles[sender]
    expected = {(role, CHANNEL[key].key_expr) for key in keys_sent(sender) for role in takers(key) if role != sender}
    arrived = set()

    def is_complete():
        for key in keys_sent(sender):
            bus.publish(CHANNEL[key], example(CHANNEL[key]))
        arrived.update(
            (role, key) for role, (_, inbox) in roles.items() for key in {parcel.key for parcel in heard(inbox)}
        )
        return expected <= arrived

    wait_until(is_complete, f"what {sender} sends", deadline_s=20)


@pytest.mark.parametrize("sender", ROLES)
def test_what_it_does_not_send_reaches_nobody(roles, sender):
    bus, _ = roles[sender]
    forgery = f"forged by {sender}".encode()
    forbidden = {channel.key_expr for channel in CHANNELS if channel.key not in (*keys_sent(sender), HEALTH.key)}
    if sender == OPERATOR:  # may all that player and page may
        forbidden -= {CHANNEL[key].key_expr for name in ("player", "teleop") for key in WIRES[name].sends}
    for _, inbox in roles.values():
        heard(inbox)  # a session hears itself, past the router
    for key_expr in sorted(forbidden):
        bus._session.put(key_expr, forgery)
        bus._session.delete(key_expr)
    allowed = HEALTH.of("player" if sender == OPERATOR else sender)
    watcher = next(role for role in READERS if role != sender)
    arrived = []

    def is_over():
        bus._session.put(allowed.key_expr, forgery)
        arrived.extend(
            (role, parcel) for role, (_, inbox) in roles.items() if role != sender for parcel in heard(inbox)
        )
        return any(role == watcher and parcel.key == allowed.key_expr for role, parcel in arrived)

    wait_until(is_over, f"the heartbeat of {sender}", deadline_s=20)
    forged = {parcel.key for _, parcel in arrived if parcel.payload in (forgery, b"")}
    assert forged == {allowed.key_expr}
