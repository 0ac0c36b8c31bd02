"""Finds a free loopback port."""

from __future__ import annotations

import socket

from shared.messaging.bus import is_reachable


def free_endpoint(endpoint: str) -> str:
    """The endpoint itself, or, where a `tcp` or `tls` one is taken, one on the same host with a free port."""
    protocol, _, address = endpoint.partition("/")
    if protocol not in ("tcp", "tls") or not is_reachable(endpoint):
        return endpoint
    host = address.rpartition(":")[0]
    with socket.create_server((host.strip("[]"), 0)) as server:
        return f"{protocol}/{host}:{server.getsockname()[1]}"
