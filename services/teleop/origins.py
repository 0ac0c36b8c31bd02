"""Which web pages may talk to the teleop server: one of another site, open in the same browser, must not."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator, Sequence

from websockets.asyncio import server
from websockets.typing import Origin

from shared.runtime.config import TeleopConfig


def origins_of(config: TeleopConfig) -> list[str]:
    """Where the page itself may have come from: loopback, the address it listens at, and what is configured."""
    hosts = dict.fromkeys(("127.0.0.1", "localhost", "[::1]", config.host))
    return [*(f"http://{host}:{config.port}" for host in hosts), *config.origins]


@contextlib.contextmanager
def only_from(origins: Sequence[str]) -> Iterator[None]:
    """A WebSocket server that starts meanwhile refuses browsers' pages of other origins, with HTTP status 403.

    viser has no setting for it, so what it calls is lent that of `websockets`. A program that says no origin is let in:
    it could claim any.
    """
    serve = server.serve
    server.serve = functools.partial(serve, origins=[None, *map(Origin, origins)])  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        server.serve = serve  # type: ignore[misc]
