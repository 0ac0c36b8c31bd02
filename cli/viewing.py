"""What `hyrecro view` does: starts a viewer, shows it a recording or the robot, and ends with it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cli.rerun_viewer import Kind, RerunViewer
from cli.view_sources import Shown, show_live, show_recordings
from services.recorder.bag.file_order import FileOrderReading
from services.viewer.canvas import TIMELINE
from shared.runtime.config import Config
from shared.runtime.exit_codes import Exit
from shared.runtime.stop_signal import StopSignal

_LIVE_PICTURE_S = 5.0
"""By then scan, map and planes have come."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What is to be shown, and how.

    recordings: one after the other; none = the robot as it is now. picture: where it goes with Kind.HEADLESS. time_s:
    simulated time that is shown; None = the newest. memory_limit: of the viewer, as Rerun takes it. page_port: with
    Kind.PAGE.
    """

    kind: Kind
    recordings: tuple[Path, ...]
    picture: Path | None
    time_s: float | None
    page_port: int
    memory_limit: str


def run_view(request: Request, config: Config) -> int:
    """Returns the exit code: 3 where a part cannot be read or drawn, 130 after Ctrl-C.

    Raises:
        InputFileError: a recording cannot be used. ViewerError: there can be no viewer.
    """
    readings = [FileOrderReading(path) for path in request.recordings]
    with (
        StopSignal() as stop,
        RerunViewer(request.kind, memory_limit=request.memory_limit, page_port=request.page_port) as viewer,
    ):
        viewer.wait_until_ready(stop.is_set)
        if request.kind is Kind.PAGE:
            print(f"open {viewer.page_url} (Ctrl-C ends)", file=sys.stderr)
        shown = _shown(request, readings, config, viewer, stop.is_set)
        _warn(shown.problems)
        reports = [] if stop.is_set() else _finish(request, shown, viewer, stop.is_set)
        _warn(reports)
    if stop.is_set():
        return stop.exit_code()
    return Exit.PARTIAL if shown.problems or reports else Exit.FINE


def _warn(problems: list[str]) -> None:
    for problem in problems:
        print(f"hyrecro: {problem}", file=sys.stderr)


def _shown(
    request: Request,
    readings: list[FileOrderReading],
    config: Config,
    viewer: RerunViewer,
    is_stopping: Callable[[], bool],
) -> Shown:
    if readings:
        return show_recordings(readings, viewer, is_stopping)
    picture_s = None if request.picture is None else request.time_s or _LIVE_PICTURE_S
    return show_live(config, viewer, picture_s, is_stopping)


def _finish(request: Request, shown: Shown, viewer: RerunViewer, is_stopping: Callable[[], bool]) -> list[str]:
    """Returns what the viewer says it could not draw, where a picture is taken."""
    if shown.newest_ns is not None and (request.picture is not None or request.time_s is not None):
        viewer.wait_until_drawn(TIMELINE, shown.newest_ns, is_stopping)
        viewer.show_time(TIMELINE, shown.newest_ns * 1e-9 if request.time_s is None else request.time_s)
    if request.picture is None:
        viewer.wait_until_closed(is_stopping)
        return []
    png, reports = viewer.picture()
    request.picture.write_bytes(png)
    return reports
