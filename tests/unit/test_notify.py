"""The datagrams between a service and its supervisor."""

import os
import socket
import subprocess
import sys

import pytest

from shared.runtime.notify import MAX_WORK_S, NotifySocket, Pulse
from tests.support.processes import ROOT, wait_until


@pytest.fixture
def supervisor():
    with_socket = NotifySocket()
    yield with_socket
    with_socket.close()


def names(supervisor):
    return [name for name, _ in supervisor.received(os.getpid())]


def test_what_is_said_arrives_in_order(supervisor):
    pulse = Pulse.from_environment(supervisor.environment(60.0))
    pulse.ready()
    pulse.status("mapper: no such file\n  nowhere.yaml")
    pulse.stopping()
    said = [pair for pair in supervisor.received(os.getpid()) if pair[0] != "WATCHDOG"]
    assert said == [("READY", "1"), ("STATUS", "mapper: no such file |   nowhere.yaml"), ("STOPPING", "1")]


def test_the_pulse_begins_with_readiness_and_goes_on(supervisor):
    pulse = Pulse.from_environment(supervisor.environment(0.09))
    assert names(supervisor) == []
    pulse.ready()
    heard = []
    wait_until(lambda: heard.extend(names(supervisor)) or heard.count("WATCHDOG") > 2, "pulses")


def test_a_loop_that_is_stuck_has_no_pulse(supervisor, monkeypatch):
    now_s = 100.0
    monkeypatch.setattr("time.monotonic", lambda: now_s)
    pulse = Pulse(supervisor.environment(1.0)["NOTIFY_SOCKET"])
    pulse.ready()
    now_s += MAX_WORK_S - 0.1
    pulse.pulse()
    assert names(supervisor) == ["READY", "WATCHDOG"]
    now_s += 0.2
    pulse.pulse()
    assert names(supervisor) == []
    pulse.beat()
    pulse.pulse()
    assert names(supervisor) == ["WATCHDOG"]


def test_no_child_of_a_service_speaks_for_it(supervisor):
    environment = {"PATH": "/bin", "WATCHDOG_PID": str(os.getpid()), **supervisor.environment(1.0)}
    Pulse.from_environment(environment)
    assert environment == {"PATH": "/bin"}


@pytest.mark.parametrize("changes", [{"WATCHDOG_PID": "1"}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": "0"}])
def test_who_is_not_watched_does_not_pulse(supervisor, changes):
    pulse = Pulse.from_environment({**supervisor.environment(0.001), **changes})
    pulse.ready()
    assert names(supervisor) == ["READY"]


@pytest.mark.parametrize("address", ["@nobody", "/no/such/socket", "", "@" + "x" * 300])
def test_without_a_supervisor_nothing_happens(address):
    pulse = Pulse.from_environment({"NOTIFY_SOCKET": address})
    pulse.ready()
    pulse.beat()
    pulse.stopping()


def test_what_others_send_is_passed_over(supervisor):
    code = "from shared.runtime.notify import Pulse; Pulse.from_environment().ready()"
    environment = {**os.environ, **supervisor.environment(60.0)}
    subprocess.run([sys.executable, "-c", code], env=environment, cwd=ROOT, check=True)
    Pulse.from_environment(supervisor.environment(60.0)).stopping()
    assert names(supervisor) == ["STOPPING"]


def test_a_supervisor_that_does_not_listen_holds_nobody_up(supervisor):
    pulse = Pulse.from_environment(supervisor.environment(60.0))
    for _ in range(10_000):  # far more than the socket's queue holds
        pulse.stopping()
    assert set(names(supervisor)) == {"STOPPING"}


@pytest.mark.parametrize("datagram", [b"", b"\xff\xfe", b"=", b"READY", b"\n\n", b"x" * 100_000])
def test_garbage_is_no_sign_of_anything(supervisor, datagram):
    name = supervisor.environment(1.0)["NOTIFY_SOCKET"]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(datagram, "\0" + name[1:])
    assert not {("READY", "1"), ("WATCHDOG", "1"), ("STOPPING", "1")} & set(supervisor.received(os.getpid()))
