"""Where drawings go: one Rerun recording, sent to a viewer or written to a file."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from rerun.urdf import UrdfTree

from services.viewer.drawing import Drawn, Edges, Model

APPLICATION = "hyrecro"
TIMELINE = "time"
"""Simulated time, as a duration."""


class Canvas:
    """A new recording with a layout. It goes nowhere before `connect` or `save`.

    newest_ns: simulated time of the newest drawing, None before the first.
    """

    def __init__(self, layout: Any) -> None:
        self.newest_ns: int | None = None
        self._stream = rr.RecordingStream(APPLICATION, send_properties=False)
        self._layout = layout
        self._frames: dict[str, str] = {}

    def connect(self, url: str) -> None:
        """Sends everything to the viewer at this URL, which has to be there."""
        self._stream.connect_grpc(url)
        self._stream.send_blueprint(self._layout)

    def save(self, path: Path) -> None:
        """Writes everything to an .rrd file."""
        self._stream.save(path, default_blueprint=self._layout)

    def draw(self, drawn: Iterable[Drawn]) -> None:
        """Adds drawings; waits where the viewer is behind by more than its connection holds."""
        for item in drawn:
            if isinstance(item, Model):
                self._add_model(item)
                continue
            if item.stamp_ns is not None:
                self.newest_ns = max(self.newest_ns or 0, item.stamp_ns)
            if isinstance(item, Edges):
                self._add_edges(item)
            else:
                self._stream.set_time(TIMELINE, duration=item.stamp_ns * 1e-9)
                self._stream.log(item.entity, item.archetype)
                self._set_frame(item.entity, item.frame)

    def close(self) -> None:
        """Returns when everything is with the viewer or in the file. Idempotent."""
        self._stream.flush()
        self._stream.disconnect()

    def _set_frame(self, entity: str, frame: str | None) -> None:
        """At all times: where nothing is drawn yet, Rerun asks for the frame too."""
        if frame is not None and self._frames.get(entity) != frame:
            self._frames[entity] = frame
            self._stream.log(entity, rr.CoordinateFrame(frame), static=True)

    def _add_edges(self, edges: Edges) -> None:
        times = []
        if edges.stamp_ns is not None:
            times = [rr.TimeColumn(TIMELINE, duration=np.full(len(edges.children), edges.stamp_ns * 1e-9))]
        columns = rr.Transform3D.columns(
            translation=edges.T_parent_child[:, :3],
            quaternion=edges.T_parent_child[:, 3:],
            parent_frame=edges.parents,
            child_frame=edges.children,
        )
        self._stream.send_columns(edges.entity, times, columns)

    def _add_model(self, model: Model) -> None:
        # Rerun reads URDF from files alone.
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{model.entity}.urdf"
            path.write_text(model.urdf)
            tree = UrdfTree.from_file_path(path, model.entity, static_transform_entity_path=f"{model.entity}/joints")
            tree.log_urdf_to_recording(self._stream)
