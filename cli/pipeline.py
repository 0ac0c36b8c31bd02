"""Starts the router and the services as child processes, waits until they are ready, stops them in order."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from shared.errors import HyrecroError
from shared.messaging.bus import Bus, is_reachable
from shared.runtime.children import end_with_parent
from shared.runtime.config import Config


def services_of(config: Config) -> tuple[dict[str, list[str]], ...]:
    """What runs: name and `python -m` arguments of each service, in groups.

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
    return {"recorder": ["services.recorder"]}, {**others, **sensors}, {"sim": ["services.sim"]}


_READY_TIMEOUT_S = 60.0
_STOP_TIMEOUT_S = 10.0


class PipelineError(HyrecroError):
    """A service that does not start or dies; the text says which one and how."""


@dataclass(frozen=True, slots=True)
class _Child:
    name: str
    process: subprocess.Popen[bytes]


class Pipeline:
    """The running processes. `arguments` (--config, --set ...) led to `config`; they go to every service.

    logs_dir: a file per process; None = they write to this process's stderr. is_joining: the router runs already.
    """

    def __init__(
        self, config: Config, arguments: list[str], *, logs_dir: Path | None = None, is_joining: bool = False
    ) -> None:
        self._bus_config, self._groups = config.bus, services_of(config)
        self._arguments = arguments
        self._logs_dir = logs_dir
        self._is_joining = is_joining
        self._children: list[_Child] = []

    def start(self, is_stopping: Callable[[], bool], on_ready: Callable[[str], None] = lambda name: None) -> None:
        """Starts the router, then every service; returns when all are ready, or early when `is_stopping`.

        Raises:
            PipelineError: the endpoint is taken, or the robot runs already, or a service ended or is not ready in time.
            BusError: there is no router to join.
        """
        if not self._is_joining:
            self._start_router(is_stopping)
            if is_stopping():
                return
            on_ready("router")
        with Bus(self._bus_config, is_stopping=is_stopping) as bus:
            if running := bus.alive() & {name for group in self._groups for name in group}:
                robot = self._bus_config.namespace or "a robot without bus.namespace"
                raise PipelineError(f"{robot} runs already: {', '.join(sorted(running))}. Set another bus.namespace")
            for group in self._groups:
                if is_stopping():
                    return
                for name, arguments in group.items():
                    self._spawn(name, ["-m", *arguments, *self._arguments])
                for name in group:
                    self._wait_until(lambda name=name: name in bus.alive(), name, is_stopping)  # type: ignore[misc]
                    if not is_stopping():
                        on_ready(name)

    def _start_router(self, is_stopping: Callable[[], bool]) -> None:
        endpoint = self._bus_config.endpoint
        if endpoint.startswith("tcp/") and is_reachable(endpoint):
            raise PipelineError(
                f"{endpoint} is taken: is another pipeline running? Set bus.endpoint to use another, or give --join"
            )
        self._spawn("router", ["-m", "cli.main", "router", "--endpoint", endpoint])
        self._wait_until(lambda: is_reachable(endpoint), "router", is_stopping)

    def ended_child(self) -> str | None:
        """What to say of a child that ended though it should run, or None."""
        for child in self._children:
            if (code := child.process.poll()) is not None:
                return f"{child.name} ended with exit code {code}{self._log_hint(child.name)}"
        return None

    def check(self) -> None:
        """Raises:
        PipelineError: a child has ended though it should run.
        """
        if (ended := self.ended_child()) is not None:
            raise PipelineError(ended)

    def stop(self) -> None:
        """Ends every process, sources first, the recorder and the router last. Idempotent."""
        while self._children:
            child = self._children.pop()
            if child.process.poll() is None:
                child.process.send_signal(signal.SIGTERM)
                try:
                    child.process.wait(_STOP_TIMEOUT_S)
                except subprocess.TimeoutExpired:
                    child.process.kill()
                    child.process.wait()

    def _spawn(self, name: str, arguments: list[str]) -> None:
        # Children stand in sessions of their own, so that Ctrl-C reaches this process alone and it decides the order.
        output = None
        if self._logs_dir is not None:
            self._logs_dir.mkdir(parents=True, exist_ok=True)
            output = (self._logs_dir / f"{name}.log").open("wb")
        try:
            process = subprocess.Popen(  # noqa: S603 - our own modules
                [sys.executable, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT if output else None,
                start_new_session=True,
                preexec_fn=end_with_parent,
            )
        finally:
            if output is not None:
                output.close()
        self._children.append(_Child(name, process))

    def _wait_until(self, is_ready: Callable[[], bool], name: str, is_stopping: Callable[[], bool]) -> None:
        deadline = time.monotonic() + _READY_TIMEOUT_S
        while not is_stopping():
            if (ended := self.ended_child()) is not None:
                raise PipelineError(ended)
            if is_ready():
                return
            if time.monotonic() > deadline:
                raise PipelineError(f"{name} is not ready after {_READY_TIMEOUT_S:g} s{self._log_hint(name)}")
            time.sleep(0.05)

    def _log_hint(self, name: str) -> str:
        if self._logs_dir is None:
            return ""
        path = self._logs_dir / f"{name}.log"
        lines = path.read_text(errors="replace").strip().splitlines()[-3:]
        return f" (see {path}): " + " | ".join(lines)

    def __enter__(self) -> Pipeline:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _tb: TracebackType | None
    ) -> None:
        self.stop()
