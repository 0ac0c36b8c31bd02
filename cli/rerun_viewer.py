"""The Rerun viewer as a child process: a window, a page on loopback, or headless. It ends with its parent."""

from __future__ import annotations

import enum
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

from shared.errors import HyrecroError
from shared.messaging.bus import is_reachable
from shared.runtime.children import ending_with_parent

_BINARY = Path(str(files("rerun_cli"))) / "rerun"
DEFAULT_PORT = 9090
DEFAULT_MEMORY = "75%"
_HOST = "127.0.0.1"
_RELAY_MEMORY = "64MiB"
"""A window keeps what was drawn itself, so the server in its process, through which drawings come, need not."""
_READY_TIMEOUT_S = 30.0
_DRAW_TIMEOUT_S = 120.0
_STOP_TIMEOUT_S = 5.0
_WINDOW = "1600x960"


def _never() -> bool:
    return False


class ViewerError(HyrecroError):
    """A viewer that does not start or does not draw; the text says why, and what helps."""


class Kind(enum.Enum):
    """How the viewer shows itself."""

    WINDOW = "window"
    PAGE = "page"
    HEADLESS = "headless"


class RerunViewer:
    """A viewer that waits for drawings at `url`. A context manager: the process ends with the block.

    memory_limit: as Rerun takes it, `2GiB` or `75%`; beyond it the oldest drawings go. page_port: where the page of
    Kind.PAGE is.

    Raises:
        ViewerError: it cannot be shown here, or the port is taken.
    """

    def __init__(self, kind: Kind, *, memory_limit: str = DEFAULT_MEMORY, page_port: int = DEFAULT_PORT) -> None:
        if kind is Kind.WINDOW and sys.platform == "linux" and not _has_display():
            raise ViewerError("there is no display for a window: give --web for a page, or --screenshot OUT.png")
        if kind is Kind.PAGE and is_reachable(f"tcp/{_HOST}:{page_port}"):
            raise ViewerError(f"port {page_port} on {_HOST} is taken: give another by --port")
        port = _free_port()
        self._kind = kind
        self.url = f"rerun+http://{_HOST}:{port}/proxy"
        self.page_url = f"http://{_HOST}:{page_port}/?url=rerun%2Bhttp%3A%2F%2F{_HOST}%3A{port}%2Fproxy"
        self._ports = [port, page_port] if kind is Kind.PAGE else [port]
        held = ["--hide-welcome-screen", "--memory-limit", memory_limit, "--server-memory-limit", _RELAY_MEMORY]
        options = {
            Kind.WINDOW: held,
            Kind.PAGE: ["--serve-web", "--web-viewer-port", str(page_port), "--server-memory-limit", memory_limit],
            Kind.HEADLESS: ["--headless", "--window-size", _WINDOW, *held],
        }[kind]
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        self._process = subprocess.Popen(  # noqa: S603 - Rerun's own program
            [_BINARY, "--bind", _HOST, "--port", str(port), *options],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            env={**os.environ, "WGPU_BACKEND": "vulkan"} if kind is Kind.HEADLESS else None,
            start_new_session=True,
            preexec_fn=ending_with_parent(),
        )

    def is_running(self) -> bool:
        """False when it was closed, or has failed."""
        return self._process.poll() is None

    def wait_until_ready(self, is_stopping: Callable[[], bool] = _never) -> None:
        """Returns when the viewer takes drawings, or early when `is_stopping`.

        Raises:
            ViewerError: it has ended, or is not ready in time.
        """
        deadline_s = time.monotonic() + _READY_TIMEOUT_S
        while not is_stopping():
            if not self.is_running() or time.monotonic() > deadline_s:
                raise ViewerError(f"the viewer does not start: {self._reason()}")
            if all(is_reachable(f"tcp/{_HOST}:{port}") for port in self._ports) and self._is_answering():
                return
            time.sleep(0.05)

    def wait_until_closed(self, is_stopping: Callable[[], bool] = _never) -> None:
        """Returns when the viewer was closed, or early when `is_stopping`."""
        while self.is_running() and not is_stopping():
            time.sleep(0.1)

    def show_time(self, timeline: str, time_s: float) -> None:
        """Sets the time that is shown, and stops there.

        Raises:
            ViewerError: it does not answer.
        """
        self._ask(lambda client: client.set_time(timeline, duration=time_s, play_state="paused"))

    def wait_until_drawn(self, timeline: str, stamp_ns: int, is_stopping: Callable[[], bool]) -> None:
        """Returns when drawings up to a time have come to the viewer, or early when `is_stopping`.

        Raises:
            ViewerError: it ended, or they do not come in time.
        """
        deadline_s = time.monotonic() + _DRAW_TIMEOUT_S
        while not is_stopping() and self._newest_ns(timeline) < stamp_ns:
            if time.monotonic() > deadline_s:
                raise ViewerError(f"the viewer has not drawn everything after {_DRAW_TIMEOUT_S:g} s")
            time.sleep(0.1)

    def picture(self) -> tuple[bytes, list[str]]:
        """What it shows now as PNG, and what it says it could not draw, a sentence each.

        Raises:
            ViewerError: it does not answer.
        """
        png: bytes = self._ask(lambda client: client.take_screenshot())
        state = self._ask(lambda client: client.get_state())
        reports = [f"view '{view.name}': {report.summary}" for view in state.views for report in view.reports]
        return png, reports

    def close(self) -> None:
        """Ends the process. Idempotent."""
        if self.is_running():
            self._process.terminate()
            try:
                self._process.wait(_STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._log.close()

    def __enter__(self) -> RerunViewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _newest_ns(self, timeline: str) -> int:
        try:
            state = self._ask(lambda client: client.get_state())
        except ViewerError:
            if not self.is_running():
                raise
            return -1  # busy drawing
        ends = [each.end for recording in state.recordings for each in recording.timelines if each.name == timeline]
        return max((end for end in ends if end is not None), default=-1)

    def _is_answering(self) -> bool:
        """A page answers in the browser; before a window has its graphics, its ports are open but nobody is there."""
        if self._kind is Kind.PAGE:
            return True
        try:
            self._ask(lambda client: client.get_state())
        except ViewerError:
            return False
        return True

    def _ask(self, question: Callable[[Any], Any]) -> Any:
        from rerun.experimental import ViewerClient

        try:
            return question(ViewerClient.connect(self.url))
        except (ConnectionError, RuntimeError, TimeoutError) as error:
            why = str(error) if self.is_running() else self._reason()
            raise ViewerError(f"the viewer does not answer: {why}") from error

    def _reason(self) -> str:
        self._log.seek(0)
        lines = [line for line in self._log.read().decode(errors="replace").splitlines() if line.strip()]
        said = next((line for line in reversed(lines) if "error" in line.lower()), lines[-1] if lines else "no reason")
        if "graphics adapter" in said:
            return "there is no Vulkan driver; Debian and Ubuntu have one in mesa-vulkan-drivers"
        return said.strip()


def _has_display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _free_port() -> int:
    with socket.create_server((_HOST, 0)) as server:
        port: int = server.getsockname()[1]
        return port
