"""Where frames are between the moments at which their poses are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared.geometry import SE3

Float = NDArray[np.float64]


class Motion:
    """Poses of one or several frames over time: linear in between (rotations at an even rate), still before and after.

    stamps_ns (K,): increasing. poses: K rows, of each frame one.

    Raises:
        ValueError: no rows, rows of unequal length, or stamps that do not increase.
    """

    def __init__(self, stamps_ns: ArrayLike, poses: Sequence[Sequence[SE3]]) -> None:
        self._stamps_ns = np.asarray(stamps_ns, dtype=np.int64)
        self._quats = np.array([[pose.quat_xyzw for pose in row] for row in poses])
        self._rotations = np.array([[pose.rotation for pose in row] for row in poses])
        self._translations = np.array([[pose.translation for pose in row] for row in poses])
        if len(poses) == 0 or self._translations.ndim != 3 or len(self._stamps_ns) != len(poses):
            raise ValueError("a motion needs a stamp a row, and in each row a pose of every frame")
        if (np.diff(self._stamps_ns) <= 0).any():
            raise ValueError("the stamps of a motion must increase")

    def at(self, stamps_ns: ArrayLike) -> tuple[Float, Float]:
        """Rotations (N, L, 3, 3) and translations (N, L, 3) of the L frames at N times."""
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        if len(self._stamps_ns) == 1:
            return (np.repeat(values, len(stamps), axis=0) for values in (self._rotations, self._translations))  # type: ignore[return-value]
        after = np.clip(np.searchsorted(self._stamps_ns, stamps, side="right"), 1, len(self._stamps_ns) - 1)
        start, end = self._stamps_ns[after - 1], self._stamps_ns[after]
        share = np.clip((stamps - start) / (end - start), 0.0, 1.0)[:, np.newaxis, np.newaxis]
        a, b = self._translations[after - 1], self._translations[after]
        return rotation_matrices(_slerp(self._quats[after - 1], self._quats[after], share)), a + share * (b - a)


def rotation_matrices(quats_xyzw: Float) -> Float:
    """Rotations (..., 3, 3) of unit quaternions (..., 4) x y z w."""
    x, y, z, w = np.moveaxis(quats_xyzw, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _slerp(a: Float, b: Float, share: Float) -> Float:
    """Spherical interpolation of unit quaternions the short way round (Shoemake 1985)."""
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    b, cosine = np.where(cosine < 0, -b, b), np.clip(np.abs(cosine), 0.0, 1.0)
    angle = np.arccos(cosine)
    sine = np.maximum(np.sin(angle), 1e-300)
    is_near = angle < 1e-6
    from_a = np.where(is_near, 1 - share, np.sin((1 - share) * angle) / sine)
    from_b = np.where(is_near, share, np.sin(share * angle) / sine)
    mixed = from_a * a + from_b * b
    unit: Float = mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)
    return unit
