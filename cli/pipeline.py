"""Starts the router and the services as child processes in order, keeps them running, stops them in order."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType

from cli.announcer import Announcer
from cli.options import Part
from shared.errors import HyrecroError
from shared.messaging.bus import Bus, is_reachable
from shared.messaging.messages import Severity
from shared.runtime.config import Config
from shared.runtime.exit_codes import Exit
from shared.runtime.supervision import POLL_S, PatientClock, Supervised

_OF_BASE = frozenset({"recorder", "evaluator", "teleop"})


def services_of(config: Config, part: Part | None = None) -> tuple[dict[str, list[str]], ...]:
    """What runs, here all or one host's part: name and `python -m` arguments of each service, in groups.

    A group is started when the one before is ready: who listens before who speaks, so that nothing said is missed. They
    are stopped the other way round.
    """
    sensors = {
        name: ["services.sensors", "--sensor", name]
        for name, sensor in config.sensors.named().items()
        if sensor.enabled
    }
    names = ("evaluator", "mapper", "planner", *(["teleop"] if config.teleop.enabled else []))
    others = {name: [f"services.{name}"] for name in names}
    groups = {"recorder": ["services.recorder"]}, {**others, **sensors}, {"sim": ["services.sim"]}
    return tuple({name: group[name] for name in group if _is_of(name, part)} for group in groups)


def _is_of(name: str, part: Part | None) -> bool:
    return part is None or (name in _OF_BASE) == (part == "base")


class PipelineError(HyrecroError):
    """A service that was given up; the text says which one and why."""


class Pipeline:
    """The running processes. `arguments` (--config, --set ...) led to `config`; they go to every service.

    One thread starts them, watches them and stops them: children end with the thread that started them.
    logs_dir: a file per process; None = they write to this process's stderr. is_joining: the router runs already.
    part: of two hosts; the robot's supervisor alone says on the bus what it did, since events have one supervisor.
    """

    def __init__(
        self,
        config: Config,
        arguments: list[str],
        *,
        logs_dir: Path | None = None,
        is_joining: bool = False,
        part: Part | None = None,
    ) -> None:
        self._bus_config, self._logs_dir, self._is_joining, self._part = config.bus, logs_dir, is_joining, part
        self._children: list[Supervised] = []
        self._clock = PatientClock()
        services = services_of(config, part)
        self._names = {name for group in services for name in group}
        router = () if is_joining else ({"router": ["cli.main", "router"]},)
        self._groups = [
            {name: [*command, *arguments] for name, command in group.items()} for group in (*router, *services)
        ]
        self._announcer = Announcer(config.bus, self._names)
        self._is_up, self._is_stopping = threading.Event(), threading.Event()
        self._pool = ThreadPoolExecutor(1, "supervisor")
        self._supervision: Future[None] | None = None

    def start(self, is_stopping: Callable[[], bool], on_ready: Callable[[str], None] = lambda name: None) -> None:
        """Starts the router, then every service; returns when all are ready, or early when `is_stopping`.

        on_ready: called on another thread.

        Raises:
            PipelineError: the endpoint is taken, the robot runs already, or a service was given up.
            BusError: there is no router to join.
        """
        self._check_bus(is_stopping)
        self._supervision = self._pool.submit(self._supervise, on_ready)
        while not (self._is_up.wait(POLL_S) or is_stopping()):
            self.check()

    def _check_bus(self, is_stopping: Callable[[], bool]) -> None:
        endpoint = self._bus_config.endpoint
        if not self._is_joining:
            if endpoint.startswith(("tcp/", "tls/")) and is_reachable(endpoint):
                raise PipelineError(
                    f"{endpoint} is taken: is another pipeline running? Set bus.endpoint to use another, or give --join"
                )
            return
        with Bus(self._bus_config, is_stopping=is_stopping) as bus:
            if running := bus.alive() & self._names:
                robot = self._bus_config.namespace or "a robot without bus.namespace"
                raise PipelineError(f"{robot} runs already: {', '.join(sorted(running))}. Set another bus.namespace")

    def has_failed(self) -> bool:
        """Whether a service was given up; all are stopped then."""
        return self._supervision is not None and self._supervision.done()

    def check(self) -> None:
        """Raises:
        PipelineError: a service was given up.
        """
        if self._supervision is not None and self._supervision.done():
            self._supervision.result()

    @property
    def num_restarts(self) -> dict[str, int]:
        """By process, of those that were started again."""
        return {child.name: child.num_restarts for child in self._children if child.num_restarts}

    @property
    def exit_code(self) -> Exit:
        """Of the stopped pipeline: 3 if its recording lacks something."""
        is_partial = any(child.name == "recorder" and child.exit_code == Exit.PARTIAL for child in self._children)
        return Exit.PARTIAL if is_partial else Exit.FINE

    def stop(self) -> None:
        """Ends every process, sources first, the recorder and the router last. Idempotent."""
        self._is_stopping.set()
        self._pool.shutdown()

    # ---- what the supervising thread does

    def _supervise(self, on_ready: Callable[[str], None]) -> None:
        try:
            if self._part == "robot":
                self._announcer.start()
            for group in self._groups:
                self._start_group(group, on_ready)
                if "recorder" in group and self._part is None:
                    self._announcer.start()
            self._is_up.set()
            while not self._is_stopping.wait(POLL_S):
                self._look()
        except OSError as error:
            raise PipelineError(f"a process cannot be started: {error}") from error
        finally:
            self._announcer.close()
            for child in reversed(self._children):
                child.stop()

    def _start_group(self, group: dict[str, list[str]], on_ready: Callable[[str], None]) -> None:
        if self._is_stopping.is_set():
            return
        now_s = self._clock.now_s()
        started = []
        for name, command in group.items():
            log_path = None if self._logs_dir is None else self._logs_dir / f"{name}.log"
            started.append(Supervised(name, ["-m", *command], now_s, log_path=log_path))
            self._children.append(started[-1])
        for child in started:
            while not child.is_ready:
                if self._is_stopping.wait(POLL_S):
                    return
                self._look()
            on_ready(child.name)

    def _look(self) -> None:
        now_s = self._clock.now_s()
        for child in self._children:
            if (comeback := child.step(now_s)) is not None:
                self._announcer.say(Severity.WARNING, comeback.text)
            if child.failure is not None:
                self._announcer.say(Severity.ERROR, child.failure)
                raise PipelineError(child.failure)

    def __enter__(self) -> Pipeline:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _tb: TracebackType | None
    ) -> None:
        self.stop()
