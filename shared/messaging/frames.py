"""Composes the edges of `Transforms` messages."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shared.errors import MessageError
from shared.geometry import SE3
from shared.messaging.messages import Transforms
from shared.motion import Motion, rotation_matrices

Float = NDArray[np.float64]


PlainPose = tuple[float, float, float, float, float, float, float]
"""x y z in metres, unit quaternion x y z w: single poses are quicker composed as plain numbers than as arrays."""


class FrameTree:
    """Where each frame of a `Transforms` message stands in the message's root frame."""

    def __init__(self, transforms: Transforms) -> None:
        self._transforms = transforms
        self._rows = _rows_of(transforms)
        self._known: dict[str, PlainPose] = {transforms.frame: (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}

    def T_root(self, frame: str) -> SE3:
        """T_root_frame: coordinates in `frame` to the root's.

        Raises:
            MessageError: the frame is unknown or not connected to the root.
        """
        return SE3.from_xyz_quat_xyzw(self.pose(frame))

    def pose(self, frame: str) -> PlainPose:
        """The same as a plain pose; `T_root` says what it raises."""
        for row in _path(self._transforms, self._rows, frame):
            parent, child = self._transforms.parents[row], self._transforms.children[row]
            if child not in self._known:
                self._known[child] = _composed(
                    self._known[parent], _unit(*self._transforms.T_parent_child[row].tolist())
                )
        return self._known[frame]


def _unit(x: float, y: float, z: float, i: float, j: float, k: float, w: float) -> PlainPose:
    """The pose with a quaternion of length 1; that of a message may be off by a thousandth."""
    length = math.sqrt(i * i + j * j + k * k + w * w)
    return x, y, z, i / length, j / length, k / length, w / length


def _composed(a: PlainPose, b: PlainPose) -> PlainPose:
    """T_a @ T_b."""
    ax, ay, az, ai, aj, ak, aw = a
    bx, by, bz, bi, bj, bk, bw = b
    ti, tj, tk = 2 * (aj * bz - ak * by), 2 * (ak * bx - ai * bz), 2 * (ai * by - aj * bx)
    return (
        ax + bx + aw * ti + aj * tk - ak * tj,
        ay + by + aw * tj + ak * ti - ai * tk,
        az + bz + aw * tk + ai * tj - aj * ti,
        aw * bi + bw * ai + aj * bk - ak * bj,
        aw * bj + bw * aj + ak * bi - ai * bk,
        aw * bk + bw * ak + ai * bj - aj * bi,
        aw * bw - ai * bi - aj * bj - ak * bk,
    )


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
    return Motion(stamps_ns, [[tree.pose(frame) for frame in frames] for tree in trees])


def _poses(transforms: Sequence[Transforms], frames: Sequence[str]) -> Float:
    """(K, L, 7) of L frames in K messages with the same edges, all messages at once."""
    first, rows, num = transforms[0], _rows_of(transforms[0]), len(transforms)
    edges = np.stack([each.T_parent_child for each in transforms])
    edges[..., 3:] /= np.linalg.norm(edges[..., 3:], axis=-1, keepdims=True)
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
