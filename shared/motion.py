"""Where frames are between the moments at which their poses are known."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float = NDArray[np.float64]


class Motion:
    """Poses of one or several frames over time: linear in between (rotations at an even rate), still before and after.

    stamps_ns (K,): increasing. poses (K, L, 7): of L frames, x y z in metres and the unit quaternion x y z w.

    Raises:
        ValueError: no poses, not one row a stamp, or stamps that do not increase.
    """

    def __init__(self, stamps_ns: ArrayLike, poses: ArrayLike) -> None:
        self._stamps_ns, known = np.asarray(stamps_ns, dtype=np.int64), np.asarray(poses, dtype=np.float64)
        if known.ndim != 3 or known.shape[2] != 7 or len(known) == 0 or len(self._stamps_ns) != len(known):
            raise ValueError(f"a motion needs poses (K, L, 7) and K stamps, got {known.shape}, {self._stamps_ns.shape}")
        if (np.diff(self._stamps_ns) <= 0).any():
            raise ValueError("the stamps of a motion must increase")
        self._translations, self._quats = known[..., :3], known[..., 3:]

    def of(self, frames: slice) -> Motion:
        """The motion of some of the frames."""
        return Motion(self._stamps_ns, np.concatenate([self._translations, self._quats], axis=-1)[:, frames])

    def at(self, stamps_ns: ArrayLike) -> tuple[Float, Float]:
        """Rotations (N, L, 3, 3) and translations (N, L, 3) of the L frames at N times."""
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        last = len(self._stamps_ns) - 1
        after = np.clip(np.searchsorted(self._stamps_ns, stamps, side="right"), min(1, last), last)
        before = np.maximum(after - 1, 0)
        start_ns, end_ns = self._stamps_ns[before], self._stamps_ns[after]
        share = np.clip((stamps - start_ns) / np.maximum(end_ns - start_ns, 1), 0.0, 1.0)[:, np.newaxis, np.newaxis]
        a, b = self._translations[before], self._translations[after]
        quats = _slerp(self._quats[before], self._quats[after], share)
        return rotation_matrices(quats), a + share * (b - a)


def rotation_matrices(quats_xyzw: Float) -> Float:
    """Rotations (..., 3, 3) of unit quaternions (..., 4) x y z w."""
    x, y, z, w = np.moveaxis(quats_xyzw, -1, 0)
    R = np.empty((*quats_xyzw.shape[:-1], 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    return R


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
