"""Attempts to command the robot by who may not: `python -m bench.attacks` runs a secure line and tries 200 times.

Each kind of attacker sends every command by put, by delete and by query, and one query on all keys. The simulation,
the planner and the recorder say in their heartbeats what they received or refused of commands: it must not change.
Before and after, the operator sends the same by put and by query, all of which must arrive.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import zenoh

from cli.certificates import Authority, credential_files, now_utc
from cli.certs_commands import write_files
from shared.messaging import messages as m
from shared.messaging.bus import Bus, is_reachable
from shared.messaging.channels import CHANNELS, HEALTH, JOINTS_STATE, PREFIX
from shared.messaging.codec import encode
from shared.runtime.config import BusConfig
from shared.runtime.roles import OPERATOR, ROLES, VIEWER

COMMANDS: dict[type[m.Message], m.Message] = {
    type(message): message
    for message in (
        m.JointTarget(q=np.full(8, 0.02)),
        m.LegTarget(foot=m.Foot.A),
        m.ActuatorTarget(positions=np.array([0.2]), names=("a1_l",)),
        m.FootTarget(point_m=np.array([0.0, 1.5, 10.1]), normal=np.array([0.0, 0.0, 1.0])),
        m.Stop(text="an attempt"),
        m.SimControl(real_time_factor=1.0),
        m.RecorderControl(action=m.RecorderAction.START),
        m.ReplayControl(action=m.ReplayAction.PAUSE),
    )
}
TARGETS = {channel.key_expr: encode(COMMANDS[channel.message]) for channel in CHANNELS if channel.is_command}
WITNESSES = ("sim", "planner", "recorder")
_OPEN_TIMEOUT_MS = 1000
_ANSWER_TIMEOUT_S = 0.3
_START_TIMEOUT_S = 90.0

Profile = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one kind of attacker achieved.

    num_connected: attempts for which the router let it open a session. num_counted: by the witnesses, where a command
    that several take, or that one takes and refuses, counts more than once.
    """

    attacker: str
    num_attempts: int
    num_connected: int
    num_answered: int
    num_counted: int


class Attackers:
    """Everything an attacker may have got hold of, and what it makes of that: a Zenoh configuration a kind."""

    def __init__(self, folder: Path) -> None:
        """Writes a good set of credentials into `folder`, for the line under attack."""
        now = now_utc()
        authority = Authority(now, now + timedelta(days=1))
        write_files(folder, credential_files(authority, ROLES))
        self._folder = folder
        self._expired = authority.client(OPERATOR, now - timedelta(seconds=1))
        self._unknown = Authority(now, now + timedelta(days=1)).client(OPERATOR)

    def kinds(self) -> dict[str, Profile | None]:
        """By name; None: no credential at all, by plain tcp."""
        viewer, operator = self._profile(VIEWER), self._profile(OPERATOR)
        password = operator["transport"]["auth"]
        return {
            "a viewer": viewer,
            "a viewer with the operator's password": _changed(viewer, auth=password),
            "an operator's certificate of an unknown authority": _shown(operator, self._unknown),
            "an operator's expired certificate": _shown(operator, self._expired),
            "a wrong password": _changed(operator, auth={"usrpwd": {"user": OPERATOR, "password": "wrong"}}),
            "no password": _changed(operator, auth={}),
            "no certificate": _changed(operator, tls={"enable_mtls": False}, without=("certificate", "private_key")),
            "plain tcp": None,
        }

    def _profile(self, role: str) -> Profile:
        profile: Profile = json.loads((self._folder / f"{role}.json5").read_text())
        return profile


def _shown(profile: Profile, certified: Any) -> Profile:
    names = {"connect_certificate_base64": certified.certificate, "connect_private_key_base64": certified.key}
    return _changed(profile, tls={name: base64.b64encode(pem).decode() for name, pem in names.items()})


def _changed(
    profile: Profile, *, auth: Profile | None = None, tls: Profile | None = None, without: tuple[str, ...] = ()
) -> Profile:
    changed: Profile = json.loads(json.dumps(profile))
    transport = changed["transport"]
    transport["auth"] = transport["auth"] if auth is None else auth
    transport["link"]["tls"] |= tls or {}
    for name in without:
        del transport["link"]["tls"][f"connect_{name}_base64"]
    return changed


@contextlib.contextmanager
def session(profile: Profile | None, endpoint: str) -> Iterator[zenoh.Session | None]:
    """The stock library's session with such a configuration; None if the router does not let it in."""
    settings = zenoh.Config() if profile is None else zenoh.Config.from_json5(json.dumps(profile))
    address = endpoint if profile is not None else endpoint.replace("tls/", "tcp/")
    settings.insert_json5("mode", '"client"')
    settings.insert_json5("scouting/multicast/enabled", "false")
    settings.insert_json5("connect/endpoints", json.dumps([address]))
    settings.insert_json5("connect/timeout_ms", str(_OPEN_TIMEOUT_MS))
    try:
        opened = zenoh.open(settings)
    except zenoh.ZError:
        yield None
        return
    try:
        yield opened
    finally:
        opened.close()  # type: ignore[no-untyped-call]


def put(sender: zenoh.Session, key_expr: str, payload: bytes) -> int:
    """Sends a command that nobody answers."""
    sender.put(key_expr, payload)
    return 0


def delete(sender: zenoh.Session, key_expr: str, _payload: bytes) -> int:
    """Sends a sample without a payload, which a subscriber gets as well."""
    sender.delete(key_expr)
    return 0


def query(sender: zenoh.Session, key_expr: str, payload: bytes) -> int:
    """Sends a command and counts the answers to it."""
    target = zenoh.QueryTarget.ALL
    return len(list(sender.get(key_expr, payload=payload, target=target, timeout=_ANSWER_TIMEOUT_S)))


Way = Callable[[zenoh.Session, str, bytes], int]
ATTEMPTS: tuple[tuple[Way, str, bytes], ...] = (
    *((way, key_expr, payload) for key_expr, payload in TARGETS.items() for way in (put, delete, query)),
    (query, PREFIX + "**", TARGETS[PREFIX + "leg/target"]),
)


def attacked(
    attacker: str, profile: Profile | None, bus: Bus, endpoint: str, attempts: tuple[tuple[Way, str, bytes], ...]
) -> Outcome:
    """Each attempt with a session of its own; then two heartbeats of every witness."""
    before, num_connected, num_answered = num_counted(bus), 0, 0
    for way, key_expr, payload in attempts:
        with session(profile, endpoint) as sender:
            if sender is not None:
                num_connected += 1
                num_answered += way(sender, key_expr, payload)
    wait_for_heartbeats(bus)
    return Outcome(attacker, len(attempts), num_connected, num_answered, num_counted(bus) - before)


def num_counted(bus: Bus) -> int:
    """Commands, and what should have been one, that came to any witness since it started."""
    healths = [bus.ask(HEALTH.of(name), m.Health) for name in WITNESSES]
    counts = [count for health in healths if health is not None for count in health.channels]
    return sum(count.num_received + count.num_refused for count in counts if count.key in TARGETS)


def wait_for_heartbeats(bus: Bus) -> None:
    """Until each witness has spoken twice: the second time it counts all that came before the first."""
    for name in WITNESSES:
        first = _heartbeat(bus, name)
        while _heartbeat(bus, name) < first + 2:
            time.sleep(0.1)


def _heartbeat(bus: Bus, name: str) -> int:
    health = bus.ask(HEALTH.of(name), m.Health)
    return -1 if health is None else health.seq


@contextlib.contextmanager
def secure_line(folder: Path) -> Iterator[tuple[Attackers, Bus, str, subprocess.Popen[bytes]]]:
    """A line without sensors on a secure bus by `hyrecro up`, and the operator's session on it."""
    attackers = Attackers(folder / "certs")
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tls/127.0.0.1:{server.getsockname()[1]}"
    credentials = folder / "certs"
    settings: dict[str, object] = {
        "bus.endpoint": endpoint,
        "bus.credentials": credentials,
        "recorder.directory": folder,
    }
    settings |= dict.fromkeys(("sensors.lidar.enabled", "sensors.depth.enabled"), "false")
    options = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    line = subprocess.Popen([sys.executable, "-m", "cli.main", "up", *options])  # noqa: S603 - our own command
    try:
        deadline_s = time.monotonic() + _START_TIMEOUT_S
        while not is_reachable(endpoint):
            _check(line, deadline_s)
            time.sleep(0.1)
        with Bus(BusConfig(endpoint=endpoint, credentials=credentials)) as bus:
            while "sim" not in bus.alive():
                _check(line, deadline_s)
                time.sleep(0.1)
            yield attackers, bus, endpoint, line
    finally:
        line.send_signal(signal.SIGINT)
        line.wait(60)


def listening(process: psutil.Process) -> list[str]:
    """Where a process and its children listen, by tcp or udp."""
    return [
        f"{one.name()} {socket_.laddr.ip}:{socket_.laddr.port}"
        for one in (process, *process.children(recursive=True))
        for socket_ in one.net_connections(kind="inet")
        if socket_.status == psutil.CONN_LISTEN or socket_.type == socket.SOCK_DGRAM
    ]


def _check(line: subprocess.Popen[bytes], deadline_s: float) -> None:
    if line.poll() is not None or time.monotonic() > deadline_s:
        raise SystemExit(f"the line did not start, exit code {line.poll()}")


def main() -> None:
    """Attacks, and prints the outcomes as a table and, if asked to, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    own = tuple((way, key_expr, payload) for key_expr, payload in TARGETS.items() for way in (put, query))
    with (
        tempfile.TemporaryDirectory() as name,
        secure_line(Path(name)) as (attackers, bus, endpoint, line),
    ):
        kinds = attackers.kinds()
        operator = json.loads((Path(name) / "certs" / f"{OPERATOR}.json5").read_text())
        outcomes = [attacked("the operator, before", operator, bus, endpoint, own)]
        before = bus.ask(JOINTS_STATE, m.JointState)
        outcomes += [attacked(kind, profile, bus, endpoint, ATTEMPTS) for kind, profile in kinds.items()]
        after = bus.ask(JOINTS_STATE, m.JointState)
        outcomes.append(attacked("the operator, after", operator, bus, endpoint, own))
        open_ports = listening(psutil.Process(line.pid))
    has_moved = before is None or after is None or not np.array_equal(before.q, after.q)
    print("| who | attempts | let in | answered | counted by the robot |\n|---|---|---|---|---|")
    for outcome in outcomes:
        print("| " + " | ".join(map(str, asdict(outcome).values())) + " |")
    print(f"joints have moved meanwhile: {has_moved}; listening: {', '.join(open_ports)}", file=sys.stderr)
    if arguments.json is not None:
        report = {
            "outcomes": [asdict(outcome) for outcome in outcomes],
            "has_moved": has_moved,
            "listening": open_ports,
        }
        arguments.json.write_text(json.dumps(report, indent=2) + os.linesep)


if __name__ == "__main__":
    main()
