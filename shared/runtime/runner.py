"""Runs one service as a process: arguments, configuration, signals, the bus, one loop, exit code."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import structlog

from shared.errors import (
    CodecError,
    ConfigError,
    HyrecroError,
    InputFileError,
    MessageError,
    RefusedError,
    StoppedError,
)
from shared.messaging.bus import Bus
from shared.messaging.channels import EVENTS, HEALTH, Channel
from shared.messaging.codec import decode, decode_command
from shared.messaging.inbox import Inbox, Parcel
from shared.messaging.messages import Event, Health, Measurement, Message, Severity
from shared.runtime.config import Config
from shared.runtime.config_loading import DEFAULT_CONFIG, load_config
from shared.runtime.exit_codes import Exit
from shared.runtime.health import Traffic
from shared.runtime.heap import give_back, share_arenas
from shared.runtime.logs import configure_logs
from shared.runtime.memory import Keeper, keeper_of
from shared.runtime.node import Addressed, Context, Messages, Node
from shared.runtime.notify import Pulse
from shared.runtime.process_load import ProcessLoad
from shared.runtime.snapshots import settings_of
from shared.runtime.stop_signal import StopSignal

log = structlog.get_logger()

BuildNode = Callable[[Config, Context], Node]

_LOG_LEVELS = {Severity.INFO: logging.INFO, Severity.WARNING: logging.WARNING, Severity.ERROR: logging.ERROR}
_HEALTH_PERIOD_S = 1.0
_NUM_HEALTHS_A_TRIM = 30
_MAX_WAIT_S = 0.1
_DRAIN_QUIET_S = 0.3
_MAX_UNDER_WAY_NS = 1_000_000_000
"""What comes later than this after the end was asked for was sent after it."""
_MAX_DRAIN_S = 5.0
"""Half of what a supervisor waits before it kills."""
_MAX_REASON_CHARS = 1000
"""Of a refusal: what is refused may be quoted in it."""
_MAX_TIMER_DELAY_S = 0.5
"""A timer that is later than this does not catch up: simulated time then runs slower than wall time."""


def run_service(name: str, build_node: BuildNode, arguments: argparse.Namespace | None = None) -> None:
    """Runs the service until it is done, SIGTERM or Ctrl-C, and ends the process with the right exit code."""
    arguments = service_parser(name).parse_args() if arguments is None else arguments
    configure_logs(verbosity=arguments.verbosity, is_json=arguments.log_json)
    structlog.contextvars.bind_contextvars(service=name)
    share_arenas()
    stop, pulse = StopSignal(), Pulse.from_environment()
    context = Context(clock_ns=time.monotonic_ns)
    exit_code = Exit.FINE
    try:
        config = load_config(arguments.config, arguments.set, os.environ)
        node = build_node(config, context)
        run_node(node, config, context, stop.is_set, pulse)
        exit_code = node.exit_code()
    except HyrecroError as error:
        if isinstance(error, ConfigError | InputFileError | StoppedError) or not stop.is_set():
            _complain(name, error, pulse)
            sys.exit(_exit_code_of(error))
    except Exception as error:
        pulse.status(f"{type(error).__name__}: {error}")
        raise
    sys.exit(stop.exit_code() or exit_code)


def service_parser(name: str) -> argparse.ArgumentParser:
    """The arguments every service takes."""
    parser = argparse.ArgumentParser(prog=f"python -m services.{name}", description=f"The {name} service.")
    parser.add_argument("--config", type=Path, default=DEFAULT_CONFIG, help="file, or name of a preset in configs/")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.KEY=VALUE", help="changes one setting")
    parser.add_argument("-v", "--verbose", action="store_const", const=1, default=0, dest="verbosity")
    parser.add_argument("-q", "--quiet", action="store_const", const=-1, dest="verbosity")
    parser.add_argument("--log-json", action="store_true", help="log lines as JSON")
    return parser


def run_node(
    node: Node, config: Config, context: Context, is_stopping: Callable[[], bool], pulse: Pulse | None = None
) -> None:
    """Connects a node to the bus and serves until it is done or `is_stopping`. pulse: what a supervisor hears.

    Raises:
        BusError: the router cannot be reached.
    """
    max_bytes = config.recorder.max_queue_mib * 1024 * 1024 if node.is_observer else None
    with Bus(config.bus, name=node.name, is_stopping=is_stopping) as bus:
        context.is_wanted = bus.is_wanted
        keeper = keeper_of(node, config.state_directory, settings_of(config))
        ServiceLoop(node, bus, context, Inbox(max_bytes=max_bytes), pulse, keeper).run(is_stopping)


def _complain(name: str, error: HyrecroError, pulse: Pulse) -> None:
    text = f"the configuration is not usable:\n{error}" if isinstance(error, ConfigError) else str(error)
    pulse.status(text)
    print(f"{name}: {text}", file=sys.stderr)


def _exit_code_of(error: HyrecroError) -> Exit:
    if isinstance(error, ConfigError | InputFileError):
        return Exit.USAGE
    return Exit.PARTIAL if isinstance(error, StoppedError) else Exit.FAILED


class ServiceLoop:
    """Takes parcels from the inbox, gives messages to the node, sends what it returns; keeps timer and heartbeat."""

    def __init__(
        self,
        node: Node,
        bus: Bus,
        context: Context,
        inbox: Inbox,
        pulse: Pulse | None = None,
        keeper: Keeper | None = None,
    ) -> None:
        self._node, self._bus, self._context, self._inbox = node, bus, context, inbox
        self._pulse, self._keeper = pulse or Pulse(), keeper
        self._traffic = Traffic()
        self._routes: dict[type[Message], Channel] = {channel.message: channel for channel in node.outputs}
        self._routes |= {Event: EVENTS, Health: HEALTH.of(node.name)}
        self._process = ProcessLoad()
        self._started_s = self._last_health_s = time.monotonic()
        self._busy_s = 0.0
        self._num_events = self._num_healths = 0

    def run(self, is_stopping: Callable[[], bool]) -> None:
        """Serves until the node is done or `is_stopping`; then the node's last messages and a last heartbeat go out."""
        node = self._node
        recalled = self._keeper.recall() if self._keeper else []
        for channel in dict.fromkeys((*node.outputs, *self._routes.values())):
            self._bus.advertise(channel)
        for channel in node.inputs:
            is_answered = not node.is_observer or channel in node.answers
            self._bus.subscribe(channel, self._inbox, is_observer=not is_answered)
        try:
            self._send([*node.on_start(), *recalled])
            self._bus.announce(node.name)
            self._pulse.ready()
            log.info("ready")
            self._serve(is_stopping)
            if node.is_observer:
                self._drain()
        finally:
            self._pulse.stopping()
            self._send(node.on_stop())
            self._send_health()
            log.info("stopped")

    def _serve(self, is_stopping: Callable[[], bool]) -> None:
        due_s = time.monotonic()
        while not (is_stopping() or self._node.is_done()):
            self._pulse.beat()
            now_s, period_s = time.monotonic(), self._timer_period_s()
            if period_s is not None and now_s >= due_s:
                self._timed(lambda: self._send(self._node.on_timer()))
                due_s = due_s + period_s if now_s - due_s < _MAX_TIMER_DELAY_S else now_s + period_s
            if now_s - self._last_health_s >= _HEALTH_PERIOD_S:
                self._send_health()
            wait_s = _MAX_WAIT_S if period_s is None else min(_MAX_WAIT_S, max(0.0, due_s - time.monotonic()))
            if (parcel := self._inbox.take(wait_s)) is not None:
                self._timed(lambda parcel=parcel: self._handle(parcel))  # type: ignore[misc]

    def _timer_period_s(self) -> float | None:
        timer_hz = self._node.timer_hz
        timer_hz = timer_hz() if callable(timer_hz) else timer_hz
        return 1.0 / timer_hz if timer_hz else None

    def _drain(self) -> None:
        """What was sent before the end was asked for may still be under way, or wait here: it is taken."""
        asked_ns = time.monotonic_ns()
        deadline_s = time.monotonic() + _MAX_DRAIN_S
        while time.monotonic() < deadline_s and (parcel := self._inbox.take(_DRAIN_QUIET_S)) is not None:
            self._handle(parcel)
            if parcel.received_ns > asked_ns + _MAX_UNDER_WAY_NS:
                break

    def _handle(self, parcel: Parcel) -> None:
        channel, key = parcel.channel, parcel.key
        self._context.received_ns = parcel.received_ns
        self._traffic.waited(key, (self._context.clock_ns() - parcel.received_ns) * 1e-9)
        message: Message | None = None
        try:
            if channel.is_command:
                message = decode_command(channel.message, parcel.payload)
            else:
                message = decode(channel.message, parcel.payload, schema=parcel.schema)
            if self._traffic.is_known(key, message, is_replay=parcel.is_replay):
                return
            self._traffic.received(key, message, tells_time=not channel.robot)
            self._send(self._node.inputs[channel](message))
        except (CodecError, MessageError, RefusedError, InputFileError) as error:
            self._refuse(parcel, f"{key}: {error}", is_message=message is not None)
        else:
            if parcel.reply is not None:
                parcel.reply(True, "")

    def _refuse(self, parcel: Parcel, reason: str, *, is_message: bool) -> None:
        self._traffic.refused(parcel.key, is_message=is_message)
        reason = reason[:_MAX_REASON_CHARS]
        if parcel.reply is not None:
            parcel.reply(False, reason)
        if parcel.channel is EVENTS:
            log.warning("refused", reason=reason)
            return  # an event about an event could be refused in turn, without end
        event = Event(
            stamp_ns=self._traffic.stamp_ns,
            seq=0,
            frame="",
            source=self._node.name,
            severity=Severity.WARNING,
            text=reason,
            refused_key=parcel.key if parcel.channel.is_command else "",
        )
        self._send([event])

    def _send(self, messages: Messages) -> None:
        messages = list(messages)
        if self._keeper is None or not messages:
            self._publish(messages)
            return
        failures = self._keeper.before_said()
        self._publish(messages)
        failures += self._keeper.after_said()
        self._publish(replace(event, stamp_ns=self._traffic.stamp_ns) for event in failures)

    def _publish(self, messages: Messages) -> None:
        for said in messages:
            channel, message = self._addressed(said)
            num_bytes = self._bus.publish(channel, message)
            seq, stamp_ns = (message.seq, message.stamp_ns) if isinstance(message, Measurement) else (None, None)
            self._traffic.sent(channel.key_expr, seq=seq, stamp_ns=stamp_ns, num_bytes=num_bytes)

    def _addressed(self, said: Message | Addressed) -> tuple[Channel, Message]:
        if isinstance(said, Addressed):
            return said.channel, said.message
        if isinstance(said, Event):
            said = replace(said, seq=self._num_events)
            self._num_events += 1
            log.log(_LOG_LEVELS[said.severity], "refused" if said.refused_key else "event", text=said.text)
        return self._routes[type(said)], said

    def _send_health(self) -> None:
        now_s = time.monotonic()
        elapsed_s = max(now_s - self._last_health_s, 1e-9)
        channel, seq, stamp_ns = HEALTH.of(self._node.name), self._num_healths, self._traffic.stamp_ns
        self._num_healths += 1
        self._traffic.sent(channel.key_expr, seq=seq, stamp_ns=None)  # it counts itself, so that the last one is exact
        inbox, load = self._inbox, self._process.look()
        health = Health(
            stamp_ns=stamp_ns,
            seq=seq,
            frame="",
            service=self._node.name,
            uptime_s=now_s - self._started_s,
            rss_bytes=load.rss_bytes,
            busy_ratio=min(1.0, self._busy_s / elapsed_s),
            channels=self._traffic.snapshot(dict(inbox.num_dropped), self._node.num_lost(), inbox.num_waiting()),
            cpu_ratio=load.cpu_ratio,
            num_open_files=load.num_open_files,
            num_threads=load.num_threads,
            shared_memory_bytes=load.shared_memory_bytes,
        )
        self._bus.publish(channel, health)
        if self._num_healths % _NUM_HEALTHS_A_TRIM == 0:
            give_back()
        self._last_health_s, self._busy_s = now_s, 0.0

    def _timed(self, work: Callable[[], None]) -> None:
        started_s = time.monotonic()
        work()
        self._busy_s += time.monotonic() - started_s
