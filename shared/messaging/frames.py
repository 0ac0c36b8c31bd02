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
    first, rows, num = transforms[0], _rows_of(transforms[0]), len(transforms)
    edges = np.stack([each.T_parent_child for each in transforms])
    turns = rotation_matrices(edges[..., 3:])
    root = np.zeros((num, 3)), np.broadcast_to([0.0, 0.0, 0.0, 1.0], (num, 4)), np.broadcast_to(np.eye(3), (num, 3, 3))
    known = {first.frame: root}
    for frame in frames:
        for row in _path(first, rows, frame):
            if first.children[row] in known:
                continue
            translation, quat, R = known[first.parents[row]]
            known[first.children[row]] = (
                translation + (R @ edges[:, row, :3, np.newaxis])[..., 0],
                _quat_product(quat, edges[:, row, 3:]),
                R @ turns[:, row],
            )
    return np.stack([np.concatenate(known[frame][:2], axis=1) for frame in frames], axis=1)


def _quat_product(a: Float, b: Float) -> Float:
    """Of unit quaternions (K, 4) x y z w: first b, then a."""
    pairs = (a[:, :, np.newaxis] * b[:, np.newaxis, :]).reshape(-1, 16)
    product: Float = pairs @ _QUAT_TABLE
    return product


def _quat_table() -> Float:
    """(16, 4): what each product of two components adds to a quaternion product (Hamilton)."""
    table = np.zeros((4, 4, 4))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        table[i, j, k], table[j, i, k] = 1.0, -1.0
        table[i, 3, i] = table[3, i, i] = 1.0
        table[i, i, 3] = -1.0
    table[3, 3, 3] = 1.0
    return table.reshape(16, 4)


_QUAT_TABLE = _quat_table()


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
