"""Rigid transforms. `T_a_b` maps coordinates of frame b into frame a: p_a = T_a_b @ p_b."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float = NDArray[np.float64]

_SMALL_ANGLE_RAD = 1e-8


@dataclass(frozen=True, slots=True, eq=False)
class SE3:
    """A rigid transform: `rotation` (3, 3) orthonormal, `translation` (3,) in metres; both float64, read-only.

    Raises:
        ValueError: wrong shape, a value that is not finite, or a rotation that is not proper orthonormal.
    """

    rotation: Float
    translation: Float

    def __post_init__(self) -> None:
        R = np.array(self.rotation, dtype=np.float64)
        t = np.array(self.translation, dtype=np.float64)
        if R.shape != (3, 3) or t.shape != (3,):
            raise ValueError(f"SE3 needs rotation (3, 3) and translation (3,), got {R.shape} and {t.shape}")
        rows = R.tolist()
        if not all(map(math.isfinite, (*rows[0], *rows[1], *rows[2], *t.tolist()))):
            raise ValueError("SE3 values must be finite")
        if not _is_rotation(rows):
            raise ValueError("SE3 rotation must be orthonormal with determinant +1; see SE3.projected")
        R.setflags(write=False)
        t.setflags(write=False)
        object.__setattr__(self, "rotation", R)
        object.__setattr__(self, "translation", t)

    @classmethod
    def identity(cls) -> SE3:
        """The transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> SE3:
        """From a homogeneous (4, 4) matrix."""
        M = np.asarray(matrix, dtype=np.float64)
        if M.shape != (4, 4):
            raise ValueError(f"SE3 matrix must be (4, 4), got {M.shape}")
        return cls(M[:3, :3], M[:3, 3])

    @classmethod
    def projected(cls, matrix: ArrayLike) -> SE3:
        """From a (4, 4) matrix whose rotation has drifted: the nearest rotation by SVD (Arun 1987) is taken."""
        M = np.asarray(matrix, dtype=np.float64)
        U, _, Vt = np.linalg.svd(M[:3, :3])
        sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
        return cls(U @ sign @ Vt, M[:3, 3])

    @classmethod
    def from_xyz_quat_xyzw(cls, pose: ArrayLike) -> SE3:
        """From (7,): x y z in metres, then the quaternion x y z w, whose length must be 1 within 1e-3."""
        values = np.asarray(pose, dtype=np.float64)
        if values.shape != (7,):
            raise ValueError(f"pose must be (7,) x y z qx qy qz qw, got {values.shape}")
        x, y, z, w = values[3:].tolist()
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        if not abs(norm - 1.0) < 1e-3:
            raise ValueError(f"quaternion length is {norm:.6g}, must be 1")
        x, y, z, w = x / norm, y / norm, z / norm, w / norm
        R = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        return cls(R, values[:3])

    @classmethod
    def rot(cls, axis: str, angle_rad: float) -> SE3:
        """Rotation by `angle_rad` about the coordinate axis "x", "y" or "z"."""
        c, s = np.cos(angle_rad), np.sin(angle_rad)
        i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        R = np.eye(3)
        R[i, i] = R[j, j] = c
        R[i, j], R[j, i] = -s, s
        return cls(R, np.zeros(3))

    @classmethod
    def trans(cls, x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.0) -> SE3:
        """Translation by (x, y, z) metres."""
        return cls(np.eye(3), np.array([x_m, y_m, z_m]))

    @classmethod
    def from_rpy(cls, rpy_rad: ArrayLike, xyz_m: ArrayLike = (0.0, 0.0, 0.0)) -> SE3:
        """From fixed-axis roll, pitch, yaw (3,) and translation (3,), as URDF's `origin` has them."""
        roll, pitch, yaw = np.asarray(rpy_rad, dtype=np.float64)
        R = (cls.rot("z", yaw) @ cls.rot("y", pitch) @ cls.rot("x", roll)).rotation
        return cls(R, np.asarray(xyz_m, dtype=np.float64))

    @classmethod
    def from_z_axis(cls, z_axis: ArrayLike, xyz_m: ArrayLike = (0.0, 0.0, 0.0)) -> SE3:
        """At `xyz_m` with z along `z_axis` (3,), of any length but 0; x lies as near to the parent's x as it can.

        Where z is within 26 degrees of the parent's x, the frame's x is near to the parent's y instead.

        Raises:
            ValueError: `z_axis` is of length 0.
        """
        z = np.asarray(z_axis, dtype=np.float64)
        length = float(np.linalg.norm(z))
        if length < 1e-12:
            raise ValueError("the z axis must not be of length 0")
        z = z / length
        near = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
        x = near - (near @ z) * z
        x /= np.linalg.norm(x)
        return cls(np.column_stack([x, np.cross(z, x), z]), np.asarray(xyz_m, dtype=np.float64))

    @classmethod
    def exp(cls, twist: ArrayLike) -> SE3:
        """Exponential of the twist (6,): translation part v first, rotation part w second (radians)."""
        xi = np.asarray(twist, dtype=np.float64)
        v, w = xi[:3], xi[3:]
        angle = float(np.linalg.norm(w))
        W = _skew(w)
        if angle < _SMALL_ANGLE_RAD:
            return cls.projected(homogeneous(np.eye(3) + W, v + 0.5 * W @ v))
        half = 0.5 * angle
        a, b = np.sin(angle) / angle, 0.5 * (np.sin(half) / half) ** 2  # b = (1 - cos) / angle^2 without cancelling
        R = np.eye(3) + a * W + b * W @ W
        V = np.eye(3) + b * W + (1 - a) / angle**2 * W @ W
        return cls(R, V @ v)

    def log(self) -> Float:
        """Twist (6,) = (v, w) with exp(log(T)) = T; the rotation angle is in [0, pi]."""
        q = self.quat_xyzw
        norm = float(np.linalg.norm(q[:3]))
        angle = 2.0 * float(np.arctan2(norm, q[3]))
        w = 2.0 * q[:3] if norm < _SMALL_ANGLE_RAD else q[:3] / norm * angle
        W = _skew(w)
        if angle < 1e-4:  # series of the inverse left Jacobian: the closed form cancels here
            V_inv = np.eye(3) - 0.5 * W + W @ W / 12.0
        else:
            half = 0.5 * angle
            V_inv = np.eye(3) - 0.5 * W + (1 - half / np.tan(half)) / angle**2 * W @ W
        return np.concatenate([V_inv @ self.translation, w])

    @property
    def matrix(self) -> Float:
        """Homogeneous (4, 4)."""
        return homogeneous(self.rotation, self.translation)

    @property
    def quat_xyzw(self) -> Float:
        """Unit quaternion (4,) x y z w with w >= 0 (Shepperd 1978)."""
        R = self.rotation
        squares = np.array([R[0, 0], R[1, 1], R[2, 2], np.trace(R)])
        k = int(np.argmax(squares))
        if k == 3:
            q = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1 + squares[3]])
        else:
            i, j = (k + 1) % 3, (k + 2) % 3
            q = np.empty(4)
            q[k] = 1 + 2 * R[k, k] - squares[3]
            q[i], q[j] = R[i, k] + R[k, i], R[j, k] + R[k, j]
            q[3] = R[j, i] - R[i, j]
        q /= np.linalg.norm(q)
        return -q if q[3] < 0 else q

    @property
    def xyz_quat_xyzw(self) -> Float:
        """Pose (7,): x y z in metres, quaternion x y z w."""
        return np.concatenate([self.translation, self.quat_xyzw])

    @property
    def rpy_rad(self) -> tuple[float, float, float]:
        """Fixed-axis roll, pitch, yaw. Yaw is undone before roll is read, which stays exact at pitch +-90 degrees."""
        R = self.rotation
        yaw = float(np.arctan2(R[1, 0], R[0, 0]))
        c, s = np.cos(yaw), np.sin(yaw)
        pitch = float(np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0]))
        roll = float(np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1]))
        return roll, pitch, yaw

    @property
    def angle_rad(self) -> float:
        """Rotation angle in [0, pi]."""
        return float(np.linalg.norm(self.log()[3:]))

    def inv(self) -> SE3:
        """The inverse: T_b_a of T_a_b."""
        return SE3(self.rotation.T, -self.rotation.T @ self.translation)

    def compose(self, other: SE3) -> SE3:
        """T_a_c = T_a_b.compose(T_b_c), the same as `T_a_b @ T_b_c`."""
        return SE3(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def apply(self, points: NDArray[np.floating]) -> NDArray[np.floating]:
        """Points (..., 3) in frame b to frame a, in the points' own float type."""
        R, t = self.rotation.astype(points.dtype), self.translation.astype(points.dtype)
        mapped: NDArray[np.floating] = points @ R.T + t
        return mapped

    def __matmul__(self, other: SE3) -> SE3:
        return self.compose(other)


def _is_rotation(rows: list[list[float]]) -> bool:
    """Whether a (3, 3) matrix is orthonormal within 1e-6 and right-handed. Plain numbers: this is asked very often."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    lengths = a * a + b * b + c * c - 1.0, d * d + e * e + f * f - 1.0, g * g + h * h + i * i - 1.0
    cosines = a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i
    is_orthonormal = max(map(abs, lengths)) <= 1e-6 and max(map(abs, cosines)) <= 1e-6
    return is_orthonormal and a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0.0


def _skew(w: Float) -> Float:
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def homogeneous(R: Float, t: Float) -> Float:
    """(4, 4) of a rotation (3, 3), or what has drifted from one, and a translation (3,)."""
    M = np.eye(4)
    M[:3, :3] = R
    M[:3, 3] = t
    return M
