"""The router inside a process of ours: `hyrecro router`, and the one that `hyrecro up` starts."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import zenoh

from shared.errors import BusError
from shared.messaging.channels import ROUTERS
from shared.messaging.credentials import SECURE_ROUTER, router_settings
from shared.messaging.joined import SplitWatch
from shared.messaging.queues import IMPLICIT_SHARED_MEMORY, ROUTER_RUNTIME, queues_of_router

_HEAR_TIMEOUT_S = 1.0


class Router:
    """An open router, and a token by which others know it."""

    def __init__(self, endpoint: str, settings: zenoh.Config) -> None:
        self._endpoint, self._settings, self._watch = endpoint, settings, SplitWatch()
        self._open()

    def rejoin(self) -> bool:
        """Opens the router anew if it is connected to another and does not hear it; returns whether it did.

        To be called every few seconds where routers are joined. After a cut Zenoh may add the new connection to an old
        one that one side has given up: then nothing is routed, without end (eclipse-zenoh/zenoh, issue 2806).
        """
        connected = {str(zid) for zid in self._session.info.routers_zid()}
        replies = self._session.liveliness().get(ROUTERS, timeout=_HEAR_TIMEOUT_S)
        heard = {str(reply.ok.key_expr).removeprefix(ROUTERS[:-1]) for reply in replies if reply.ok is not None}
        if not self._watch.is_split(connected, heard):
            return False
        self.close()
        self._open()
        return True

    def close(self) -> None:
        """Leaves the port."""
        self._session.close()  # type: ignore[no-untyped-call]

    def _open(self) -> None:
        try:
            self._session = zenoh.open(self._settings)
        except zenoh.ZError as error:
            raise BusError(f"cannot listen on {self._endpoint}: {error}") from error
        self._token = self._session.liveliness().declare_token(ROUTERS.replace("*", str(self._session.zid())))


@contextlib.contextmanager
def open_router(endpoint: str, *, credentials: Path | None = None, peers: Sequence[str] = ()) -> Iterator[Router]:
    """A Zenoh router inside this process, listening on `endpoint` alone.

    peers: endpoints of other hosts' routers, which it joins as soon as they run, and again after each cut.
    credentials: the folder of `hyrecro certs new`, for a router that asks everyone who they are.

    Raises:
        BusError: the endpoint is taken or not valid. ConfigError: the credentials cannot be used.
    """
    settings = zenoh.Config() if credentials is None else zenoh.Config.from_file(str(SECURE_ROUTER))
    for key, value in router_settings(credentials).items() if credentials else ():
        settings.insert_json5(key, value)
    settings.insert_json5("mode", '"router"')
    settings.insert_json5("listen/endpoints", json.dumps([endpoint]))
    settings.insert_json5("connect/endpoints", json.dumps(list(peers)))
    settings.insert_json5("scouting/multicast/enabled", "false")
    settings.insert_json5("timestamping/enabled", "true")
    settings.insert_json5(IMPLICIT_SHARED_MEMORY, "false")  # it passes on what others put there, and puts nothing
    for path, number in queues_of_router().items():
        settings.insert_json5(path, str(number))
    os.environ.setdefault("ZENOH_RUNTIME", ROUTER_RUNTIME)  # read by zenoh's first session of a process
    router = Router(endpoint, settings)
    try:
        yield router
    finally:
        router.close()
