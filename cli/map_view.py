"""What `hyrecro map` shows in Rerun while the map grows: the scene of `hyrecro view`, of what the mapper says."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from services.mapper.mapper import Mapper
from services.viewer.canvas import Canvas
from services.viewer.layout import map_layout
from services.viewer.scene import Scene, scan_drawing
from shared.messaging.channels import EVENTS, LIDAR_POINTS, MAP_CLOUD, MAP_ODOMETRY, MAP_PLANES, MAP_STATUS
from shared.messaging.messages import Message, Odometry

Show = Callable[[Mapper, list[Message]], None]

_CHANNELS = {channel.message: channel for channel in (EVENTS, MAP_CLOUD, MAP_ODOMETRY, MAP_PLANES, MAP_STATUS)}


@contextmanager
def viewed(is_live: bool, rrd: Path | None) -> Iterator[Show]:
    """Gives what is to be called after each scan: it draws scan, map, planes and the way so far.

    is_live: in a window of its own, until that is closed. rrd: to a file, which `rerun` opens.
    """
    if rrd is not None:
        canvas = Canvas(map_layout())
        canvas.save(rrd)
        yield from _drawn(canvas)
    elif is_live:
        from cli.rerun_viewer import Kind, RerunViewer

        with RerunViewer(Kind.WINDOW) as viewer:
            viewer.wait_until_ready()
            canvas = Canvas(map_layout())
            canvas.connect(viewer.url)
            yield from _drawn(canvas)
            print("hyrecro: goes on when the viewer is closed", file=sys.stderr)
            viewer.wait_until_closed()
    else:
        yield lambda _mapper, _said: None


def _drawn(canvas: Canvas) -> Iterator[Show]:
    drawing = _MapDrawing(canvas)
    yield drawing.show
    drawing.show_whole_map()
    canvas.close()


class _MapDrawing:
    def __init__(self, canvas: Canvas) -> None:
        self._canvas, self._scene = canvas, Scene()
        self._mapper: Mapper | None = None

    def show(self, mapper: Mapper, said: list[Message]) -> None:
        self._mapper = mapper
        for message in said:
            self._draw(message)
            if isinstance(message, Odometry) and mapper.last is not None:
                points_m = mapper.last.points_m
                self._canvas.draw([scan_drawing(LIDAR_POINTS.key, points_m, message.child_frame, message.stamp_ns)])

    def show_whole_map(self) -> None:
        if self._mapper is not None:
            self._draw(self._mapper.map_cloud())
            self._draw(self._mapper.map_planes())

    def _draw(self, message: Message) -> None:
        self._canvas.draw(self._scene.draw(_CHANNELS[type(message)], message))
