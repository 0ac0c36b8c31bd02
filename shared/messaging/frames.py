"""Composes the edges of a `Transforms` message."""

from __future__ import annotations

from shared.errors import MessageError
from shared.geometry import SE3
from shared.messaging.messages import Transforms


class FrameTree:
    """Where each frame of a `Transforms` message stands in the message's root frame."""

    def __init__(self, transforms: Transforms) -> None:
        self._root = transforms.frame
        self._edges = {
            child: (parent, row)
            for parent, child, row in zip(
                transforms.parents, transforms.children, transforms.T_parent_child, strict=True
            )
        }

    def has(self, frame: str) -> bool:
        """Whether the frame is the root or one of the children."""
        return frame == self._root or frame in self._edges

    def T_root(self, frame: str) -> SE3:
        """T_root_frame: coordinates in `frame` to the root's.

        Raises:
            MessageError: the frame is unknown or not connected to the root.
        """
        T_root_frame = SE3.identity()
        visited = frame
        for _ in range(len(self._edges) + 1):
            if visited == self._root:
                return T_root_frame
            if visited not in self._edges:
                break
            visited, row = self._edges[visited]
            T_root_frame = SE3.from_xyz_quat_xyzw(row) @ T_root_frame
        raise MessageError(f"no path from {self._root!r} to frame {frame!r}")
