"""What a process tells its supervisor: datagrams of systemd's sd_notify protocol, so that systemd understands them too.

Source: sd_notify(3), sd_watchdog_enabled(3).
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import threading
import time
from collections.abc import MutableMapping

MAX_WORK_S = 30.0
"""A loop that has been in one piece of work for longer counts as stuck: no service works so long on a message."""
_PULSES_A_LIMIT = 4.5
"""How often a pulse comes in the time after which its absence counts."""
_MAX_DATAGRAM = 4096
_CREDENTIALS = struct.Struct("3i")  # struct ucred of unix(7): pid, uid, gid


class Pulse:
    """Tells that this process is ready, alive, or ends; does nothing where nobody asked for it.

    address: of the supervisor's socket. limit_s: how long it waits for a pulse. The pulse has a thread of its own, so a
    loop that works long is not taken for dead; it stops when the loop does not `beat` for `MAX_WORK_S`.
    """

    def __init__(self, address: str | None = None, limit_s: float | None = None) -> None:
        self._address = address
        self._period_s = None if limit_s is None else limit_s / _PULSES_A_LIMIT
        self._beaten_s = time.monotonic()

    @classmethod
    def from_environment(cls, environment: MutableMapping[str, str] = os.environ) -> Pulse:
        """As NOTIFY_SOCKET and WATCHDOG_USEC ask; they are taken away, since children of this process are not it."""
        names = ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID")
        address, limit_us, pid = (environment.pop(name, "") for name in names)
        is_watched = limit_us.isdecimal() and int(limit_us) > 0 and pid in ("", str(os.getpid()))
        return cls(address or None, int(limit_us) / 1e6 if is_watched else None)

    def ready(self) -> None:
        """The process does its work from now on, and pulses."""
        self.beat()
        self._send("READY=1")
        if self._address is not None and self._period_s is not None:
            threading.Thread(target=self._pulsate, args=(self._period_s,), name="pulse", daemon=True).start()

    def beat(self) -> None:
        """The loop goes on: called between two pieces of work."""
        self._beaten_s = time.monotonic()

    def pulse(self) -> None:
        """Says once that it is alive, unless the loop is stuck."""
        if time.monotonic() - self._beaten_s < MAX_WORK_S:
            self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """The process ends."""
        self._send("STOPPING=1")

    def status(self, text: str) -> None:
        """One line for people: why it ends."""
        self._send("STATUS=" + " | ".join(text.splitlines())[: _MAX_DATAGRAM // 4])

    def _pulsate(self, period_s: float) -> None:
        while True:
            self.pulse()
            time.sleep(period_s)

    def _send(self, text: str) -> None:
        if self._address is None:
            return
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)  # a supervisor that is held up must not hold up who it watches
            sender.sendto(text.encode(), address)


class NotifySocket:
    """Where a supervisor hears one child: a socket without a file, named by the kernel."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.bind("")

    def environment(self, limit_s: float) -> dict[str, str]:
        """What the child is told. limit_s: how long its pulse may be away."""
        name: bytes = self._socket.getsockname()
        return {"NOTIFY_SOCKET": "@" + name[1:].decode(), "WATCHDOG_USEC": str(int(limit_s * 1e6))}

    def received(self, pid: int) -> list[tuple[str, str]]:
        """What that process has said since the last call, as name and value; what others send is passed over."""
        said = []
        with contextlib.suppress(BlockingIOError):
            while True:
                data, ancillary, _, _ = self._socket.recvmsg(_MAX_DATAGRAM, socket.CMSG_SPACE(_CREDENTIALS.size))
                if any(_CREDENTIALS.unpack(content)[0] == pid for _, _, content in ancillary):
                    said += [_assignment(line) for line in data.decode(errors="replace").splitlines()]
        return said

    def close(self) -> None:
        """Idempotent."""
        self._socket.close()


def _assignment(line: str) -> tuple[str, str]:
    name, _, value = line.partition("=")
    return name, value
