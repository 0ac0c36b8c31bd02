"""What `hyrecro map` shows in Rerun while the map grows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from services.mapper.mapper import Mapper
from shared.messaging.channels import MAP_CLOUD, MAP_PLANES
from shared.messaging.messages import MapStatus, Message, Odometry

Show = Callable[[Mapper, list[Message]], None]

_MAP_EVERY = 10
"""Scans between two pictures of the whole map."""


@contextmanager
def viewed(is_live: bool, rrd: Path | None) -> Iterator[Show]:
    """Gives what is to be called after each scan: it draws scan, map, planes and the way so far.

    is_live: in a viewer of its own. rrd: to a file, which `rerun` opens.
    """
    if not is_live and rrd is None:
        yield lambda _mapper, _said: None
        return
    import rerun as rr

    stream = rr.RecordingStream("hyrecro map")
    if rrd is not None:
        stream.save(rrd)
    else:
        stream.spawn()
    stream.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    drawing = _Drawing(stream)
    try:
        yield drawing.show
    finally:
        if drawing.last is not None:
            drawing.draw_map(drawing.last)
        stream.flush()


class _Drawing:
    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self._way: list[np.ndarray] = []
        self.last: Mapper | None = None

    def show(self, mapper: Mapper, said: list[Message]) -> None:
        import rerun as rr

        self.last = mapper
        for message in said:
            if isinstance(message, MapStatus):
                self._stream.set_time("time", duration=message.stamp_ns * 1e-9)
                self._stream.log("status/score", rr.Scalars(message.score))
                self._stream.log("status/registration_ms", rr.Scalars(message.registration_ms))
        if mapper.last is not None and any(isinstance(message, Odometry) for message in said):
            self._way.append(mapper.last.T_map_sensor.translation)
            scan_m = mapper.last.T_map_sensor.apply(mapper.last.points_m)
            self._stream.log("map/scan", rr.Points3D(scan_m, radii=0.01, colors=[255, 170, 40]))
            self._stream.log("map/way", rr.LineStrips3D([np.array(self._way)], colors=[80, 200, 255]))
        if len(self._way) % _MAP_EVERY == 1:
            self.draw_map(mapper)

    def draw_map(self, mapper: Mapper) -> None:
        import rerun as rr

        planes = mapper.map_planes().planes
        outlines = [np.vstack([plane.outline_m, plane.outline_m[:1]]) for plane in planes]
        self._stream.log(MAP_CLOUD.key, rr.Points3D(mapper.target.points_m, radii=0.008, colors=[150, 150, 160]))
        self._stream.log(MAP_PLANES.key, rr.LineStrips3D(outlines, colors=[plane.colour for plane in planes]))
