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
        vx, vy, vz, x, y, z = np.asarray(twist, dtype=np.float64).tolist()
        angle = math.sqrt(x * x + y * y + z * z)
        a, b, c = _coefficients(angle)
        R = _plus_skew(a, b, x, y, z)
        V = _plus_skew(b, c, x, y, z)
        t = [row[0] * vx + row[1] * vy + row[2] * vz for row in V]
        return cls(np.array(R), np.array(t))

    def log(self) -> Float:
        """Twist (6,) = (v, w) with exp(log(T)) = T; the rotation angle is in [0, pi]."""
        x, y, z, w = self.quat_xyzw.tolist()
        norm = math.sqrt(x * x + y * y + z * z)
        angle = 2.0 * math.atan2(norm, w)
        scale = 2.0 if norm < _SMALL_ANGLE_RAD else angle / norm
        x, y, z = x * scale, y * scale, z * scale
        # The inverse left Jacobian; its closed form cancels where the angle is small.
        half = 0.5 * angle
        c = 1.0 / 12.0 if angle < 1e-4 else (1.0 - half / math.tan(half)) / angle**2
        tx, ty, tz = self.translation.tolist()
        v = [row[0] * tx + row[1] * ty + row[2] * tz for row in _plus_skew(-0.5, c, x, y, z)]
        return np.array([*v, x, y, z])

    @property
    def matrix(self) -> Float:
        """Homogeneous (4, 4)."""
        return homogeneous(self.rotation, self.translation)

    @property
    def quat_xyzw(self) -> Float:
        """Unit quaternion (4,) x y z w with w >= 0 (Shepperd 1978)."""
        rows = self.rotation.tolist()
        squares = [rows[0][0], rows[1][1], rows[2][2]]
        trace = sum(squares)
        k = squares.index(max(squares))
        q = [rows[2][1] - rows[1][2], rows[0][2] - rows[2][0], rows[1][0] - rows[0][1], 1.0 + trace]
        if squares[k] > trace:
            i, j = (k + 1) % 3, (k + 2) % 3
            q[3] = q[k]
            q[k] = 1.0 + 2.0 * squares[k] - trace
            q[i], q[j] = rows[i][k] + rows[k][i], rows[j][k] + rows[k][j]
        length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        length = -length if q[3] < 0.0 else length
        return np.array([q[0] / length, q[1] / length, q[2] / length, q[3] / length])

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


def _coefficients(angle_rad: float) -> tuple[float, float, float]:
    """sin(a) / a, (1 - cos(a)) / a^2, (a - sin(a)) / a^3, also where a is small."""
    if angle_rad < 1e-4:
        square = angle_rad * angle_rad
        return 1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    half = 0.5 * angle_rad
    a, b = math.sin(angle_rad) / angle_rad, 0.5 * (math.sin(half) / half) ** 2  # without cancelling
    return a, b, (1.0 - a) / (angle_rad * angle_rad)


def _plus_skew(a: float, b: float, x: float, y: float, z: float) -> list[list[float]]:
    """Rows of I + a W + b W W, with W the cross product's matrix of (x, y, z)."""
    xx, yy, zz = x * x, y * y, z * z
    return [
        [1.0 - b * (yy + zz), b * x * y - a * z, b * x * z + a * y],
        [b * x * y + a * z, 1.0 - b * (xx + zz), b * y * z - a * x],
        [b * x * z - a * y, b * y * z + a * x, 1.0 - b * (xx + yy)],
    ]


def homogeneous(R: Float, t: Float) -> Float:
    """(4, 4) of a rotation (3, 3), or what has drifted from one, and a translation (3,)."""
    M = np.eye(4)
    M[:3, :3] = R
    M[:3, 3] = t
    return M
