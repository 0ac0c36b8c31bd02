"""Composes the edges of `Transforms` messages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shared.errors import MessageError
from shared.geometry import SE3
from shared.messaging.messages import Transforms
from shared.motion import Motion, rotation_matrices

Float = NDArray[np.float64]


class FrameTree:
    """Where each frame of a `Transforms` message stands in the message's root frame."""

    def __init__(self, transforms: Transforms) -> None:
        self._transforms = transforms
        self._rows = _rows_of(transforms)
        self._known = {transforms.frame: SE3.identity()}

    def T_root(self, frame: str) -> SE3:
        """T_root_frame: coordinates in `frame` to the root's.

        Raises:
            MessageError: the frame is unknown or not connected to the root.
        """
        for row in _path(self._transforms, self._rows, frame):
            parent, child = self._transforms.parents[row], self._transforms.children[row]
            if child not in self._known:
                T_parent_child = SE3.from_xyz_quat_xyzw(self._transforms.T_parent_child[row])
                self._known[child] = self._known[parent] @ T_parent_child
        return self._known[frame]


def motion_of(transforms: Sequence[Transforms], frames: Sequence[str]) -> Motion:
    """How these frames move in the root frame, over the stamps of the messages.

    Raises:
        MessageError: a frame is unknown or not connected to the root.
        ValueError: no messages, or stamps that do not increase.
    """
    is_same_tree = len({(each.frame, each.parents, each.children) for each in transforms}) == 1
    stamps_ns = [each.stamp_ns for each in transforms]
    if is_same_tree and len(transforms) > 2:
        return Motion(stamps_ns, _poses(transforms, frames))
    trees = [FrameTree(each) for each in transforms]
    return Motion(stamps_ns, [[tree.T_root(frame).xyz_quat_xyzw for frame in frames] for tree in trees])


def _poses(transforms: Sequence[Transforms], frames: Sequence[str]) -> Float:
    """(K, L, 7) of L frames in K messages with the same edges, all messages at once."""
    first, rows = transforms[0], _rows_of(transforms[0])
    edges = np.stack([each.T_parent_child for each in transforms])
    known = {first.frame: np.broadcast_to([0.0, 0, 0, 0, 0, 0, 1], (len(transforms), 7))}
    for frame in frames:
        for row in _path(first, rows, frame):
            if first.children[row] not in known:
                known[first.children[row]] = _composed(known[first.parents[row]], edges[:, row])
    return np.stack([known[frame] for frame in frames], axis=1)


def _composed(a: Float, b: Float) -> Float:
    """T_a @ T_b of poses (K, 7)."""
    translation = a[:, :3] + np.einsum("kij,kj->ki", rotation_matrices(a[:, 3:]), b[:, :3])
    u, s, v, w = a[:, 3:6], a[:, 6:], b[:, 3:6], b[:, 6:]
    quat = np.concatenate([s * v + w * u + np.cross(u, v), s * w - np.sum(u * v, axis=1, keepdims=True)], axis=1)
    return np.concatenate([translation, quat / np.linalg.norm(quat, axis=1, keepdims=True)], axis=1)


def _rows_of(transforms: Transforms) -> dict[str, int]:
    return {child: row for row, child in enumerate(transforms.children)}


def _path(transforms: Transforms, rows: dict[str, int], frame: str) -> list[int]:
    """The edges from the root to a frame.

    Raises:
        MessageError: there is no such path.
    """
    path: list[int] = []
    at = frame
    while at != transforms.frame:
        if at not in rows or rows[at] in path:
            raise MessageError(f"no path from {transforms.frame!r} to frame {frame!r}")
        path.append(rows[at])
        at = transforms.parents[rows[at]]
    return path[::-1]
