"""A TCP link with little bandwidth: a relay on loopback that reads from one end only so many bytes a second."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

_PERIOD_S = 0.01


@contextmanager
def slow_link(endpoint: str, bytes_per_s: int) -> Iterator[str]:
    """The endpoint of a relay to `endpoint`; what flows back from there is slow, what flows to it is not."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=_accept, args=(server, (host, int(port)), bytes_per_s), daemon=True)
        thread.start()
        yield f"tcp/127.0.0.1:{server.getsockname()[1]}"


def _accept(server: socket.socket, address: tuple[str, int], bytes_per_s: int) -> None:
    while True:
        try:
            near, _ = server.accept()
        except OSError:  # closed: the link is no longer wanted
            return
        far = socket.socket()
        far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 64 * 1024)
        far.connect(address)
        threading.Thread(target=_relay, args=(near, far, None), daemon=True).start()
        threading.Thread(target=_relay, args=(far, near, bytes_per_s), daemon=True).start()


def _relay(source: socket.socket, sink: socket.socket, bytes_per_s: int | None) -> None:
    num_bytes = 65_536 if bytes_per_s is None else max(1, int(bytes_per_s * _PERIOD_S))
    try:
        while data := source.recv(num_bytes):
            sink.sendall(data)
            if bytes_per_s is not None:
                time.sleep(len(data) / bytes_per_s)
    except OSError:
        pass
    finally:
        for end in (source, sink):
            end.close()
