"""Brings a recording, or a robot, to a Rerun viewer."""

from __future__ import annotations

import contextlib
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from cli.playback import progress_bar
from cli.rerun_viewer import RerunViewer
from services.recorder.bag.file_order import FileOrderReading
from services.viewer.canvas import Canvas
from services.viewer.layout import robot_layout
from services.viewer.live import LiveView
from services.viewer.node import node_of
from services.viewer.scene import Scene, has_picture
from shared.errors import BusError, InputFileError
from shared.messaging.bus import is_reachable
from shared.runtime.config import Config
from shared.runtime.logs import configure_logs
from shared.runtime.node import Context
from shared.runtime.runner import run_node

_STEP_MESSAGES = 200


@dataclass
class Shown:
    """newest_ns: simulated time of the newest drawing, None where there is none. problems: a sentence each."""

    newest_ns: int | None
    problems: list[str] = field(default_factory=list)


def show_recordings(readings: list[FileOrderReading], viewer: RerunViewer, is_stopping: Callable[[], bool]) -> Shown:
    """Draws recordings from head to end, one after the other, or until the viewer is closed or `is_stopping`.

    Raises:
        InputFileError: nothing in them has a picture.
    """
    canvas = Canvas(robot_layout())
    canvas.connect(viewer.url)
    with progress_bar() as progress:
        task = progress.add_task("drawing", total=sum(reading.num_bytes for reading in readings))
        for _ in _draw_steps(readings, canvas):
            progress.update(task, completed=sum(reading.num_read for reading in readings))
            if is_stopping() or not viewer.is_running():
                return Shown(canvas.newest_ns)
        canvas.close()
    if canvas.newest_ns is None:
        raise InputFileError(f"{readings[0].path}: holds no message that could be drawn")
    return Shown(canvas.newest_ns, [problem for reading in readings for problem in _problems_of(reading)])


def _draw_steps(readings: list[FileOrderReading], canvas: Canvas) -> Iterator[None]:
    """Draws, and comes up now and then."""
    scene = Scene()
    for reading in readings:
        messages = reading.messages(lambda channel, ns: has_picture(channel) and scene.is_due(channel, ns))
        for number, (channel, message) in enumerate(messages):
            canvas.draw(scene.draw(channel, message))
            if number % _STEP_MESSAGES == 0:
                yield


def _problems_of(reading: FileOrderReading) -> list[str]:
    problems = []
    if reading.is_truncated:
        problems.append(
            f"{reading.path}: has no proper end; what is readable is shown, "
            "and `hyrecro bag recover` makes a whole file of it"
        )
    if reading.num_unreadable:
        counts = ", ".join(f"{num} of {topic}" for topic, num in reading.num_unreadable.items())
        problems.append(f"{reading.path}: messages that cannot be read, of another version: {counts}")
    return problems


def show_live(config: Config, viewer: RerunViewer, picture_s: float | None, is_stopping: Callable[[], bool]) -> Shown:
    """Draws what the robot says until the viewer is closed or `is_stopping`; waits for a pipeline, and for the next.

    Ctrl-Z is not heard: a stopped subscriber would hold up the bus, and with it the robot.

    picture_s: ends when so much simulated time has been drawn; None = no such end.
    """
    configure_logs(verbosity=-1)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)
    endpoint = config.bus.endpoint
    if not is_reachable(endpoint):
        print(f"hyrecro: no router at {endpoint} yet; waiting for one", file=sys.stderr)
    while True:
        canvas = Canvas(robot_layout())
        canvas.connect(viewer.url)
        view = LiveView(canvas.draw)

        def is_ending(view: LiveView = view) -> bool:
            is_enough = picture_s is not None and view.newest_ns is not None and view.newest_ns >= picture_s * 1e9
            return is_enough or is_stopping() or not viewer.is_running()

        with contextlib.suppress(BusError):  # no router yet
            run_node(node_of(view, config, is_ending), config, Context(clock_ns=time.monotonic_ns), is_ending)
        if viewer.is_running():
            canvas.close()
        if is_ending():
            return Shown(canvas.newest_ns)
