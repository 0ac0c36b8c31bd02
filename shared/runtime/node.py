"""What a service is to the runner: named inputs, outputs and a timer around a facade. No arithmetic happens here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from shared.messaging.channels import Channel
from shared.messaging.messages import Message
from shared.runtime.exit_codes import Exit


@dataclass(frozen=True, slots=True)
class Addressed:
    """A message and the channel it goes to, where its type alone does not tell; it is sent as it is."""

    channel: Channel
    message: Message


Messages = Iterable[Message | Addressed]
Handler = Callable[[Any], Messages]


@dataclass(frozen=True, slots=True)
class Part:
    """One file of a memory. kind: of the state. snapshot: the state now; None: nothing is worth keeping yet.

    period_s: how old the file may be; 0: nothing is said before the state that says it is kept.
    """

    kind: type[Message]
    snapshot: Callable[[], Message | None]
    period_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Memory:
    """What a service knows again when it is started again in the same run.

    restore: gets the state of every part, by name, before `on_start`; returns what follows. It takes up all of it or,
    where it cannot, nothing, and raises HyrecroError or ValueError.
    """

    parts: Mapping[str, Part]
    restore: Callable[[Mapping[str, Any]], Messages]


def _nothing() -> Messages:
    return ()


def _never() -> bool:
    return False


def _nobody(_channel: Channel) -> bool:
    return False


def _none() -> Mapping[str, int]:
    return {}


def _fine() -> Exit:
    return Exit.FINE


@dataclass(frozen=True, kw_only=True)
class Node:
    """Wiring of one service.

    inputs: channel -> facade method; it gets the decoded message and returns the messages that follow from it. On a
    command channel it may raise RefusedError. outputs: the channels the returned messages go to, by message type (one
    channel a type) or as an `Addressed` says. on_start, on_timer and on_stop return messages in the same way; an Event
    gets its `seq` from the runner, which says events too. timer_hz: of the wall's clock; a function is asked anew each
    time. is_done: whether the service has finished by itself. is_observer: it only watches: it takes every message of
    every input through one bounded queue, also where the channel says LATEST, and leaves commands to others to answer,
    but those in `answers`. num_lost: by key expression, what came and was lost then, for the heartbeat. exit_code: of
    the process, when it ends by itself or by SIGTERM.
    """

    name: str
    inputs: Mapping[Channel, Handler] = field(default_factory=dict)
    outputs: tuple[Channel, ...] = ()
    on_start: Callable[[], Messages] = _nothing
    on_timer: Callable[[], Messages] = _nothing
    on_stop: Callable[[], Messages] = _nothing
    is_done: Callable[[], bool] = _never
    timer_hz: float | Callable[[], float] | None = None
    is_observer: bool = False
    answers: tuple[Channel, ...] = ()
    num_lost: Callable[[], Mapping[str, int]] = _none
    exit_code: Callable[[], Exit] = _fine
    memory: Memory | None = None


@dataclass(kw_only=True)
class Context:
    """What the runner lends to a node: a monotonic clock, and when the message in hand was received (same clock).

    is_wanted: whether anybody subscribes to a channel now; for what is costly to make.
    """

    clock_ns: Callable[[], int]
    received_ns: int = 0
    is_wanted: Callable[[Channel], bool] = _nobody
