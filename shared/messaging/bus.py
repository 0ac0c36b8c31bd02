"""The bus: one Zenoh session as publishers, subscribers, commands and queries. Zenoh is used in this folder alone."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Callable
from typing import Any, TypeVar

import zenoh

from shared.errors import BusError, ConfigError, RefusedError
from shared.messaging.channels import ALIVE, PREFIX, PUBLISHED, Channel, Delivery
from shared.messaging.codec import MIME, decode, encode, schema_of
from shared.messaging.credentials import WHY_REFUSED, credential_of
from shared.messaging.inbox import Inbox, Parcel
from shared.messaging.messages import Message
from shared.messaging.pool import Pool
from shared.messaging.queues import IMPLICIT_SHARED_MEMORY, queues_of_client
from shared.runtime.config import BusConfig
from shared.runtime.roles import OPERATOR

M = TypeVar("M", bound=Message)

_QUERY_TIMEOUT_S = 2.0
_RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
"""How often a router that went away is tried again; Zenoh's own first try is after a second."""


class Bus:
    """A session that talks in channels and messages. `name` says whose credential a secure bus is shown.

    Raises:
        BusError: the router at `config.endpoint` cannot be reached within `connect_timeout_s`, or does not let us in.
        ConfigError: the credential cannot be used.
    """

    def __init__(
        self, config: BusConfig, *, name: str = OPERATOR, is_stopping: Callable[[], bool] = lambda: False
    ) -> None:
        settings = _client_settings(config, name)
        _wait_for_router(config, is_stopping)
        try:
            self._session = zenoh.open(settings)
        except zenoh.ZError as error:
            reason = error if config.credentials is None else WHY_REFUSED
            raise BusError(f"cannot open a session on {config.endpoint}: {reason}") from error
        self._config, self._name = config, name
        self._pool = Pool(config.shared_memory_mib * 1024 * 1024)
        self._open_session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._kept: dict[str, tuple[bytes, str]] = {}
        self._declared: list[Any] = []

    # ---- what a service does

    def advertise(self, channel: Channel) -> None:
        """Declares that this session publishes the channel; a kept channel also answers queries from now on."""
        congestion = zenoh.CongestionControl
        is_latest = channel.delivery is Delivery.LATEST
        self._publishers[channel.key] = self._session.declare_publisher(
            channel.key_expr,
            encoding=f"{MIME};{schema_of(channel.message)}",
            congestion_control=congestion.DROP if is_latest else congestion.BLOCK,
            priority=_priority(channel),
        )
        if channel.is_kept:
            self._declared.append(
                self._session.declare_queryable(channel.key_expr, lambda query: self._answer_kept(channel, query))
            )
        self._hold(PUBLISHED.replace("**", channel.key))  # last: who sees it asks

    def publish(self, channel: Channel, message: Message) -> int:
        """Sends a message on an advertised channel; returns how many bytes it has."""
        payload = encode(message)
        if channel.is_kept:  # first, or a late joiner's question could fall between the two
            self._kept[channel.key] = (payload, f"{MIME};{schema_of(channel.message)}")
        self._publishers[channel.key].put(self._pool.place(payload))
        return len(payload)

    def is_wanted(self, channel: Channel) -> bool:
        """Whether anybody subscribes to an advertised channel now."""
        publisher = self._publishers.get(channel.key)
        status: Any = publisher.matching_status if publisher else None  # zenoh's type hint says bool, which it is not
        return status is not None and bool(status.matching)

    def subscribe(self, channel: Channel, inbox: Inbox, *, is_observer: bool = False) -> None:
        """Lets what comes on the channel into the inbox: messages, commands as queries, and the last kept message.

        A publisher of a kept channel is asked for it when it is seen: at once, when it comes later, and when the router
        is back that was away.
        is_observer: commands that come as queries are seen, but their answer is left to who carries them out.
        """

        def on_sample(sample: zenoh.Sample) -> None:
            inbox.put(_parcel(channel, sample))

        session = self._session_for(channel)
        self._declared.append(session.declare_subscriber(channel.key_expr, on_sample))
        if channel.is_command:
            self._declared.append(
                self._session.declare_queryable(
                    channel.key_expr,
                    lambda query: _take_query(channel, query, inbox, is_observer=is_observer),
                )
            )
        if channel.is_kept:
            token = channel.key_expr.replace(PREFIX, PUBLISHED.removesuffix("**"))
            self._declared.append(
                session.liveliness().declare_subscriber(
                    token, lambda seen: self._ask_kept(channel, seen, inbox), history=True
                )
            )

    def announce(self, name: str) -> None:
        """Holds the liveliness token of this service until the bus is closed."""
        self._hold(ALIVE.replace("*", name))

    # ---- what a person or a program does

    def ask(self, channel: Channel, message_type: type[M], timeout_s: float = _QUERY_TIMEOUT_S) -> M | None:
        """The last message of a kept channel from its publisher, or None if nobody answers in time.

        Raises:
            CodecError: the answer is not such a message.
        """
        for reply in self._session.get(channel.key_expr, priority=_priority(channel), timeout=timeout_s):
            if (sample := reply.ok) is not None:
                return decode(message_type, sample.payload.to_bytes(), schema=_schema(sample.encoding))
        return None

    def command(self, channel: Channel, message: Message, timeout_s: float = _QUERY_TIMEOUT_S) -> None:
        """Sends a command and waits until the robot accepts it.

        Raises:
            RefusedError: with the reason the robot gives.
            BusError: nobody answers.
        """
        replies = self._session.get(
            channel.key_expr, payload=encode(message), priority=_priority(channel), timeout=timeout_s
        )
        for reply in replies:
            if (refusal := reply.err) is not None:
                raise RefusedError(refusal.payload.to_string())
            return
        hint = " Or may this credential not command?" if self._config.credentials is not None else ""
        raise BusError(f"nobody answers on {channel.key_expr}: is the simulation running?{hint}")

    def alive(self, timeout_s: float = _QUERY_TIMEOUT_S) -> set[str]:
        """Names of the services that are ready now."""
        return self._held(ALIVE.removesuffix("*"), timeout_s)

    def published(self, timeout_s: float = _QUERY_TIMEOUT_S) -> set[str]:
        """Keys below `hyrecro/` that somebody publishes now, this session among them."""
        return self._held(PUBLISHED.removesuffix("**"), timeout_s)

    def close(self) -> None:
        """Undeclares everything and closes the session. Idempotent; must be called, or the process hangs at exit."""
        for declared in [*self._declared, *self._publishers.values()]:
            with contextlib.suppress(zenoh.ZError):
                declared.undeclare()
        self._declared.clear()
        self._publishers.clear()
        for session in (self._session, self._open_session):
            if session is not None and not session.is_closed():
                session.close()  # type: ignore[no-untyped-call]
        self._pool.close()

    def __enter__(self) -> Bus:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _session_for(self, channel: Channel) -> zenoh.Session:
        """Our own, or for another robot's channels one without namespace: a namespace hears nothing from outside."""
        if not (channel.robot and self._config.namespace):
            return self._session
        if self._open_session is None:
            self._open_session = zenoh.open(
                _client_settings(self._config.model_copy(update={"namespace": ""}), self._name)
            )
        return self._open_session

    def _hold(self, token: str) -> None:
        self._declared.append(self._session.liveliness().declare_token(token))

    def _held(self, stem: str, timeout_s: float) -> set[str]:
        """What stands behind the stem in the tokens that are held now."""
        replies = self._session.liveliness().get(stem + "**", timeout=timeout_s)
        return {str(reply.ok.key_expr).partition(stem)[2] for reply in replies if reply.ok is not None}

    def _ask_kept(self, channel: Channel, token: zenoh.Sample, inbox: Inbox) -> None:
        def on_reply(reply: zenoh.Reply) -> None:
            if (sample := reply.ok) is not None:
                inbox.put(_parcel(channel, sample, is_replay=True))

        if token.kind == zenoh.SampleKind.PUT:
            key = _key_of(channel, token.key_expr).replace(PUBLISHED.removesuffix("**"), PREFIX)
            with contextlib.suppress(zenoh.ZError):  # the session is being closed
                session = self._session_for(channel)
                session.get(key, on_reply, priority=_priority(channel), timeout=_QUERY_TIMEOUT_S)

    def _answer_kept(self, channel: Channel, query: zenoh.Query) -> None:
        with query:
            if (kept := self._kept.get(channel.key)) is not None:
                query.reply(channel.key_expr, self._pool.place(kept[0]), encoding=kept[1])


def is_reachable(endpoint: str) -> bool:
    """Whether somebody accepts connections at a `tcp/` or `tls/HOST:PORT`; other transports are taken as reachable."""
    protocol, _, address = endpoint.partition("/")
    if protocol not in ("tcp", "tls"):
        return True
    host, _, port = address.rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=1.0):
            return True
    except (OSError, ValueError):
        return False


def _wait_for_router(config: BusConfig, is_stopping: Callable[[], bool]) -> None:
    deadline = time.monotonic() + config.connect_timeout_s
    while not is_reachable(config.endpoint):
        if is_stopping():
            raise BusError("stopped while waiting for the router")
        if time.monotonic() > deadline:
            raise BusError(
                f"no router at {config.endpoint} after {config.connect_timeout_s:g} s: "
                "start one with `hyrecro router`, or set bus.endpoint"
            )
        time.sleep(0.05)


def _client_settings(config: BusConfig, name: str) -> zenoh.Config:
    credential = credential_of(config, name)
    try:
        settings = zenoh.Config.from_file(str(credential)) if credential else zenoh.Config()
    except zenoh.ZError as error:
        raise ConfigError([f"bus.credentials: {credential}: not a Zenoh configuration: {error}"]) from error
    settings.insert_json5("mode", '"client"')
    settings.insert_json5("connect/endpoints", json.dumps([config.endpoint]))
    settings.insert_json5("connect/timeout_ms", str(int(config.connect_timeout_s * 1000)))
    settings.insert_json5("connect/retry", json.dumps(_RETRY))
    settings.insert_json5("scouting/multicast/enabled", "false")
    settings.insert_json5("timestamping/enabled", "true")
    for path, value in queues_of_client().items():
        settings.insert_json5(path, str(value))
    settings.insert_json5("transport/shared_memory/enabled", json.dumps(config.shared_memory_mib > 0))
    settings.insert_json5(IMPLICIT_SHARED_MEMORY, "false")  # the bus has a pool of its own
    if config.namespace:
        settings.insert_json5("namespace", json.dumps(config.namespace))
    return settings


def _priority(channel: Channel) -> zenoh.Priority:
    """Each kind of message waits in a queue of its own on every link: a scan that finds no room holds up no other."""
    if channel.delivery is Delivery.EVERY:
        return zenoh.Priority.INTERACTIVE_HIGH
    return zenoh.Priority.DATA_LOW if channel.is_large else zenoh.Priority.DATA


def _schema(encoding: zenoh.Encoding) -> str | None:
    mime, _, schema = str(encoding).partition(";")
    return schema if mime == MIME and schema else None


def _key_of(channel: Channel, key_expr: zenoh.KeyExpr) -> str:
    """A channel of one key has that key, whatever expression such as `hyrecro/$*` somebody has sent it on."""
    return str(key_expr) if channel.has_many_keys else channel.key_expr


def _parcel(channel: Channel, sample: zenoh.Sample, *, is_replay: bool = False) -> Parcel:
    # The bytes are copied here: a ZBytes kept in the queue would hold a piece of the sender's shared memory.
    key, schema = _key_of(channel, sample.key_expr), _schema(sample.encoding)
    return Parcel(channel, key, sample.payload.to_bytes(), schema, time.monotonic_ns(), is_replay=is_replay)


def _take_query(channel: Channel, query: zenoh.Query, inbox: Inbox, *, is_observer: bool) -> None:
    if query.payload is None:
        with query:
            if not is_observer:
                query.reply_err("send the command as the payload of the query")
        return

    def reply(is_accepted: bool, reason: str) -> None:
        with query:
            if is_accepted:
                query.reply(channel.key_expr, json.dumps({"accepted": True}), encoding="application/json")
            else:
                query.reply_err(reason, encoding="text/plain")

    payload, key, now_ns = query.payload.to_bytes(), channel.key_expr, time.monotonic_ns()
    if is_observer:
        query.drop()  # type: ignore[no-untyped-call]
        inbox.put(Parcel(channel, key, payload, None, now_ns))
    elif not inbox.put(Parcel(channel, key, payload, None, now_ns, reply=reply)):
        reply(False, "too many commands are waiting")
