"""Two network namespaces, `hyrecro_robot` and `hyrecro_base`, with a wire between them. Needs root and iproute2."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import IO, cast

from bench.hosts.wire import Quality

ADDRESSES = {"robot": "10.77.0.1", "base": "10.77.0.2"}
_PREFIX = "hyrecro_"


class Network:
    """The two hosts, and the link between them."""

    def __init__(self, wire: subprocess.Popen[str]) -> None:
        self._wire = wire

    def set_quality(self, quality: Quality) -> dict[str, int]:
        """From now on; returns how many packets and bytes were carried and lost since the last time."""
        commands, answers = cast(IO[str], self._wire.stdin), cast(IO[str], self._wire.stdout)
        commands.write(json.dumps(asdict(quality)) + "\n")
        commands.flush()
        counts: dict[str, int] = json.loads(answers.readline())
        return counts


def on_host(host: str, *command: str) -> list[str]:
    """The command as it is run on `robot` or `base`, with a /dev/shm of its own: hosts share no memory."""
    private = ["unshare", "--mount", "sh", "-c", 'mount -t tmpfs tmpfs /dev/shm && exec "$@"', "sh"]
    return ["ip", "netns", "exec", _PREFIX + host, *private, *command]


@contextlib.contextmanager
def network() -> Iterator[Network]:
    """Makes both hosts, and takes them away at the end."""
    made: list[str] = []
    devices = {host: f"hyr_{host}" for host in ADDRESSES}
    wire = subprocess.Popen(  # noqa: S603 - our own module
        [sys.executable, "-m", "bench.hosts.wire", *devices.values()],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        cast(IO[str], wire.stdout).readline()
        for host, device in devices.items():
            _ip("netns", "add", _PREFIX + host)
            made.append(host)
            _ip("link", "set", device, "netns", _PREFIX + host)
            _ip("-n", _PREFIX + host, "addr", "add", f"{ADDRESSES[host]}/24", "dev", device)
            for name in (device, "lo"):
                _ip("-n", _PREFIX + host, "link", "set", name, "up")
        yield Network(wire)
    finally:
        cast(IO[str], wire.stdin).close()
        wire.wait(5.0)
        for host in made:
            _ip("netns", "del", _PREFIX + host)


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True)  # noqa: S603, S607 - iproute2, wherever it is
