"""One step of a pose from moments, with the patches held or free.

A plane (n, d) of the map is (R^T n, n.t + d) in the lidar frame: alpha (4,), so that a point's distance is
alpha.(p, 1), and the points on it say alpha^T M alpha. Small steps change alpha by J (4, 9): the lidar's translation
and rotation along its own axes, then the patch's tilt along two tangents and its offset at its origin.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.association import Association
from services.mapper.planes.moments import times
from services.mapper.planes.patches import PatchArrays
from shared.kernel import kernel, lean_kernel

Float = NDArray[np.float64]

NUM_POSE = 6
NUM_PATCH = 3
ALPHA = NUM_POSE + NUM_PATCH
NUM_COLUMNS = ALPHA + 1
_MAX_STEP = 0.3
"""Metres and radians together: from farther away the patches were not the right ones."""
HELD = 1e3
"""Damping (1/m^2, 1/rad^2), about what one point at 30 mm of noise says: directions of which no more is known stay."""
_HELD_SHARE = 1e-3
"""Damping as a share of all weight: few points, at the edges of faces, do not move a pose along an open direction."""


@lean_kernel()
def tangents(normal: Float, B: Float) -> None:
    """Writes two unit vectors B (3, 2) at right angles to a unit normal (3,) and to one another."""
    k = 0
    for i in range(1, 3):
        if abs(normal[i]) < abs(normal[k]):
            k = i
    length = math.sqrt(1.0 - normal[k] * normal[k])
    for i in range(3):
        B[i, 0] = ((1.0 if i == k else 0.0) - normal[k] * normal[i]) / length
    for i in range(3):
        j, m = (i + 1) % 3, (i + 2) % 3
        B[i, 1] = normal[j] * B[m, 0] - normal[m] * B[j, 0]


@lean_kernel()
def pose_columns(T: Float, plane: Float, J: Float) -> None:
    """Writes the columns of the pose and, last, alpha itself into J (4, 10), for a pose T (3, 4)."""
    for row in range(J.shape[0]):
        for column in range(J.shape[1]):
            J[row, column] = 0.0
    for i in range(3):
        J[i, ALPHA] = T[0, i] * plane[0] + T[1, i] * plane[1] + T[2, i] * plane[2]
    J[3, ALPHA] = T[0, 3] * plane[0] + T[1, 3] * plane[1] + T[2, 3] * plane[2] + plane[3]
    a, b, c = J[0, ALPHA], J[1, ALPHA], J[2, ALPHA]
    J[3, 0], J[3, 1], J[3, 2] = a, b, c
    J[0, 4], J[0, 5] = -c, b
    J[1, 3], J[1, 5] = c, -a
    J[2, 3], J[2, 4] = -b, a


@lean_kernel()
def patch_columns(T: Float, B: Float, origin: Float, J: Float) -> None:
    """Writes the columns of the patch into J (4, 10)."""
    for q in range(2):
        for i in range(3):
            J[i, NUM_POSE + q] = T[0, i] * B[0, q] + T[1, i] * B[1, q] + T[2, i] * B[2, q]
        lever = 0.0
        for r in range(3):
            lever += B[r, q] * (T[r, 3] - origin[r])
        J[3, NUM_POSE + q] = lever
    J[3, NUM_POSE + 2] = 1.0


@lean_kernel()
def prior_columns(plane: Float, B: Float, origin: Float, J: Float) -> None:
    """Writes the columns of the patch into J (4, 10) as its own moments in the map see them, and its plane last."""
    for row in range(J.shape[0]):
        for column in range(J.shape[1]):
            J[row, column] = 0.0
    for i in range(3):
        J[i, NUM_POSE], J[i, NUM_POSE + 1], J[i, ALPHA] = B[i, 0], B[i, 1], plane[i]
    J[3, NUM_POSE + 2] = 1.0
    J[3, ALPHA] = plane[0] * origin[0] + plane[1] * origin[1] + plane[2] * origin[2] + plane[3]


@lean_kernel()
def add_products(M: Float, J: Float, first: int, MJ: Float, N: Float) -> None:
    """N += J^T M J from the column `first` on. MJ (4, 10): room to work in."""
    for q in range(first, NUM_COLUMNS):
        times(M, J, q, MJ)
    for p in range(first, NUM_COLUMNS):
        for q in range(first, NUM_COLUMNS):
            N[p, q] += J[0, p] * MJ[0, q] + J[1, p] * MJ[1, q] + J[2, p] * MJ[2, q] + J[3, p] * MJ[3, q]


@lean_kernel()
def eliminate_patch(N: Float) -> None:
    """Takes the patch out of N (10, 10): what is left is what the pose may still hope for (Schur complement)."""
    for p in range(NUM_POSE + NUM_PATCH - 1, NUM_POSE - 1, -1):
        pivot = N[p, p]
        if pivot <= 0.0:
            continue
        for i in range(NUM_COLUMNS):
            if i == p or (NUM_POSE <= i < ALPHA and i > p):
                continue
            factor = N[i, p] / pivot
            for j in range(NUM_COLUMNS):
                N[i, j] -= factor * N[p, j]


@lean_kernel(fastmath={"contract", "reassoc", "nsz"})
def factorise(H: Float) -> None:
    """The lower half of a positive definite H (K, K) becomes its Cholesky factor."""
    for i in range(len(H)):
        for j in range(i + 1):
            s = H[i, j]
            for k in range(j):
                s -= H[i, k] * H[j, k]
            H[i, j] = math.sqrt(max(s, 1e-12)) if i == j else s / H[j, j]


@lean_kernel()
def solve_factorised(L: Float, x: Float) -> None:
    """x (K,) becomes the solution of L L^T x = x, with a lower L (K, K)."""
    K = len(x)
    for i in range(K):
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    for i in range(K - 1, -1, -1):
        for k in range(i + 1, K):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]


@lean_kernel()
def step_pose(T: Float, x: Float) -> None:
    """Moves T (3, 4) by x (6,): translation, then rotation, along the lidar's axes."""
    angle = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
    a = 1.0 - angle * angle / 6.0 if angle < 1e-5 else math.sin(angle) / angle
    b = 0.5 - angle * angle / 24.0 if angle < 1e-5 else (1.0 - math.cos(angle)) / (angle * angle)
    u, v, w = x[3], x[4], x[5]
    for i in range(3):
        r0, r1, r2 = T[i, 0], T[i, 1], T[i, 2]
        T[i, 3] += r0 * x[0] + r1 * x[1] + r2 * x[2]
        T[i, 0] = r0 * (1.0 - b * (v * v + w * w)) + r1 * (a * w + b * u * v) + r2 * (-a * v + b * u * w)
        T[i, 1] = r0 * (-a * w + b * u * v) + r1 * (1.0 - b * (u * u + w * w)) + r2 * (a * u + b * v * w)
        T[i, 2] = r0 * (a * v + b * u * w) + r1 * (-a * u + b * v * w) + r2 * (1.0 - b * (u * u + v * v))


@lean_kernel()
def orthonormalise(T: Float) -> None:
    """The rotation in T (3, 4), nearly one, becomes the nearest one (a step of Newton's for the polar factor)."""
    c00, c11, c22 = _dot(T, 0, 0), _dot(T, 1, 1), _dot(T, 2, 2)
    c01, c02, c12 = _dot(T, 0, 1), _dot(T, 0, 2), _dot(T, 1, 2)
    for i in range(3):
        a, b, c = T[i, 0], T[i, 1], T[i, 2]
        T[i, 0] = 1.5 * a - 0.5 * (a * c00 + b * c01 + c * c02)
        T[i, 1] = 1.5 * b - 0.5 * (a * c01 + b * c11 + c * c12)
        T[i, 2] = 1.5 * c - 0.5 * (a * c02 + b * c12 + c * c22)


@lean_kernel()
def _dot(T: Float, p: int, q: int) -> float:
    """Of two columns of T (3, 4)."""
    return float(T[0, p] * T[0, q] + T[1, p] * T[1, q] + T[2, p] * T[2, q])


@kernel()
def _take_step(N: Float, damping: float, T: Float) -> float:
    """Solves the sum N (10, 10) for the pose and moves it; returns the largest part of the step."""
    H, x = np.empty((NUM_POSE, NUM_POSE)), np.empty(NUM_POSE)
    for p in range(NUM_POSE):
        half = 3 * (p // 3)
        weight = N[half, half] + N[half + 1, half + 1] + N[half + 2, half + 2]
        for q in range(NUM_POSE):
            H[p, q] = N[p, q]
        H[p, p] = H[p, p] * (1.0 + damping) + HELD + _HELD_SHARE * weight
        x[p] = -N[p, ALPHA]
    factorise(H)
    solve_factorised(H, x)
    length = math.sqrt(np.sum(x * x))
    if length > _MAX_STEP:
        x *= _MAX_STEP / length
    step_pose(T, x)
    return float(np.max(np.abs(x)))


@kernel()
def gauss_newton(
    T: Float, found: Association, patches: PatchArrays, min_points: int, is_joint: bool, damping: float
) -> float:
    """Moves T (3, 4) one step towards the patches; returns the largest part of the step, in metres and radians.

    is_joint: the patches may move too, as far as their moments in the map allow, and are eliminated.
    """
    total, N = np.zeros((NUM_COLUMNS, NUM_COLUMNS)), np.empty((NUM_COLUMNS, NUM_COLUMNS))
    J, MJ, B = np.empty((4, NUM_COLUMNS)), np.empty((4, NUM_COLUMNS)), np.empty((3, 2))
    for k in range(found.num_touched[0]):
        j = found.touched[k]
        if found.num_points[j] < min_points:
            continue
        plane, origin = patches.planes[j], patches.origins[j]
        pose_columns(T, plane, J)
        N[:] = 0.0
        if is_joint:
            tangents(plane[:3], B)
            patch_columns(T, B, origin, J)
            add_products(found.moments[j], J, 0, MJ, N)
            prior_columns(plane, B, origin, J)
            add_products(patches.moments[j], J, NUM_POSE, MJ, N)
            eliminate_patch(N)
        else:
            add_products(found.moments[j], J, 0, MJ, N)
        total += N
    return _take_step(total, damping, T)


@kernel()
def normal_sums(T: Float, found: Association, planes: Float, H: Float) -> tuple[float, int]:
    """Writes the sum H (6, 6) of the points' squared normals, each point with weight 1, along the lidar's axes.

    Returns the sum of the points' squared distances in m^2, and their number.
    """
    N, J, MJ = np.zeros((NUM_COLUMNS, NUM_COLUMNS)), np.empty((4, NUM_COLUMNS)), np.empty((4, NUM_COLUMNS))
    unweighted, num = np.empty(10), 0
    for k in range(found.num_touched[0]):
        j = found.touched[k]
        num += found.num_points[j]
        unweighted[:] = found.moments[j] * (found.num_points[j] / found.moments[j, 9])
        pose_columns(T, planes[j], J)
        add_products(unweighted, J, 0, MJ, N)
    H[:] = N[:NUM_POSE, :NUM_POSE]
    return N[ALPHA, ALPHA], num
