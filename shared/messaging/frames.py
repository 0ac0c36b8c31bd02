"""Composes the edges of a `Transforms` message."""

from __future__ import annotations

from shared.errors import MessageError
from shared.geometry import SE3
from shared.messaging.messages import Transforms


class FrameTree:
    """Where each frame of a `Transforms` message stands in the message's root frame."""

    def __init__(self, transforms: Transforms) -> None:
        self._root = transforms.frame
        self._known = {self._root: SE3.identity()}
        self._edges = {
            child: (parent, row)
            for parent, child, row in zip(
                transforms.parents, transforms.children, transforms.T_parent_child, strict=True
            )
        }

    def T_root(self, frame: str) -> SE3:
        """T_root_frame: coordinates in `frame` to the root's.

        Raises:
            MessageError: the frame is unknown or not connected to the root.
        """
        chain: list[str] = []  # the frame and its parents, up to one whose place is known
        while frame not in self._known:
            if frame not in self._edges or frame in chain:
                raise MessageError(f"no path from {self._root!r} to frame {chain[0] if chain else frame!r}")
            chain.append(frame)
            frame = self._edges[frame][0]
        for child in reversed(chain):
            parent, row = self._edges[child]
            self._known[child] = self._known[parent] @ SE3.from_xyz_quat_xyzw(row)
        return self._known[chain[0] if chain else frame]
