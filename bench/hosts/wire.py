"""A link between two network namespaces that delays, loses and cuts: packets go through this process, one by one.

The kernel's own emulator (tc netem) is a module that many machines lack; this needs /dev/net/tun and root alone.
`python -m bench.hosts.wire TUN_A TUN_B` carries packets; a line `{"loss": 0.01, "delay_s": 0.02, "is_cut": false}` on
stdin changes how, and is answered by a line with what was carried since the last.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import random
import selectors
import struct
import sys
import time
from collections import Counter, deque
from dataclasses import dataclass, field

_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000  # linux/if_tun.h
_MAX_PACKET = 65_536
_MAX_WAITING = 1000
"""Packets under way to one side: a router's buffer, beyond which they are lost."""


@dataclass(slots=True)
class Quality:
    """loss: chance of each packet. delay_s: one way. is_cut: nothing passes."""

    loss: float = 0.0
    delay_s: float = 0.0
    is_cut: bool = False


@dataclass(slots=True)
class _Side:
    device: int
    waiting: deque[tuple[float, bytes]] = field(default_factory=deque)


class Wire:
    """Two tun devices, each of which gets what the other sends. Reproducible losses for the same packets."""

    def __init__(self, devices: tuple[int, int]) -> None:
        self.quality = Quality()
        self._sides = [_Side(device) for device in devices]
        self._rng = random.Random(1)  # noqa: S311 - no secret
        self._counts: Counter[str] = Counter()

    def take(self, device: int) -> None:
        """Reads one packet of a device; it is lost, or will come out of the other."""
        packet = os.read(device, _MAX_PACKET)
        other = self._sides[0 if device == self._sides[1].device else 1]
        quality = self.quality
        is_lost = quality.is_cut or self._rng.random() < quality.loss or len(other.waiting) >= _MAX_WAITING
        self._counts["num_lost" if is_lost else "num_carried"] += 1
        if not is_lost:
            self._counts["num_bytes"] += len(packet)
            other.waiting.append((time.monotonic() + quality.delay_s, packet))

    def deliver(self) -> float | None:
        """Hands out what is due; returns in how many seconds the next is."""
        now_s, next_s = time.monotonic(), None
        for side in self._sides:
            while side.waiting and side.waiting[0][0] <= now_s:
                with contextlib.suppress(OSError):  # the device is not up yet
                    os.write(side.device, side.waiting.popleft()[1])
            if side.waiting:
                wait_s = max(0.0, side.waiting[0][0] - now_s)
                next_s = wait_s if next_s is None else min(next_s, wait_s)
        return next_s

    def counts(self) -> dict[str, int]:
        """Since the last call."""
        counts, self._counts = dict(self._counts), Counter()
        return counts


def open_tun(name: str) -> int:
    """A new device of this name in the network namespace of this process."""
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH", name.encode(), _IFF_TUN | _IFF_NO_PI))
    return device


def main() -> None:
    """Carries packets until stdin ends."""
    devices = open_tun(sys.argv[1]), open_tun(sys.argv[2])
    wire = Wire(devices)
    print("ready", flush=True)
    with selectors.DefaultSelector() as selector:
        for file in (*devices, sys.stdin.fileno()):
            selector.register(file, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select(wire.deliver()):
                if key.fd != sys.stdin.fileno():
                    wire.take(key.fd)
                    continue
                if not (line := sys.stdin.readline()):
                    return
                wire.quality = Quality(**json.loads(line))
                print(json.dumps(wire.counts()), flush=True)


if __name__ == "__main__":
    main()
