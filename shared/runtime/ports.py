"""Finds a free loopback port."""

from __future__ import annotations

import socket

from shared.messaging.bus import is_reachable


def free_endpoint(endpoint: str) -> str:
    """The endpoint itself, or, where a `tcp` one is taken, one on the same host with a free port."""
    if not endpoint.startswith("tcp/") or not is_reachable(endpoint):
        return endpoint
    host = endpoint.removeprefix("tcp/").rpartition(":")[0]
    with socket.create_server((host.strip("[]"), 0)) as server:
        return f"tcp/{host}:{server.getsockname()[1]}"
