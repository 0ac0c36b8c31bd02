"""The equations of whole-run refinement: a block for each (scan, patch), poses eliminated, patches left."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.gauss_newton import (
    ALPHA,
    NUM_COLUMNS,
    NUM_PATCH,
    NUM_POSE,
    add_products,
    factorise,
    patch_columns,
    pose_columns,
    solve_factorised,
    step_pose,
    tangents,
)
from shared.kernel import kernel, lean_kernel

Float = NDArray[np.float64]
Int = NDArray[np.int64]

_USUAL_CHI2 = 2.0
"""A block whose points lie farther off their patch than twice what noise explains counts less: it may be wrong."""
_POSE_HELD = 1.0
_PATCH_HELD = 1e-2
"""Damping (1/m^2, 1/rad^2), so that what no block says anything of stays: a point says 1e3 and more."""


class Blocks(NamedTuple):
    """What scans say of patches: scans (B,), increasing, patches (B,), moments (B, 10), num_points (B,)."""

    scans: Int
    patches: Int
    moments: Float
    num_points: Int


class Equations(NamedTuple):
    """Normal equations of poses (N, 6, 6), (N, 6) and patches (P, 3, 3), (P, 3), and what couples them (B, 6, 3).

    solved (B, 6, 3), pose_solved (N, 6): inverse pose blocks times couplings and gradients. reduced (3P, 3P),
    reduced_gradient (3P,): of the patches alone.
    """

    pose: Float
    pose_gradient: Float
    patch: Float
    patch_gradient: Float
    coupling: Float
    solved: Float
    pose_solved: Float
    reduced: Float
    reduced_gradient: Float


def empty_equations(num_scans: int, num_patches: int, num_blocks: int) -> Equations:
    """Equations of so many poses, patches and blocks."""
    size = NUM_PATCH * num_patches
    return Equations(
        np.zeros((num_scans, NUM_POSE, NUM_POSE)),
        np.zeros((num_scans, NUM_POSE)),
        np.zeros((num_patches, NUM_PATCH, NUM_PATCH)),
        np.zeros((num_patches, NUM_PATCH)),
        np.zeros((num_blocks, NUM_POSE, NUM_PATCH)),
        np.zeros((num_blocks, NUM_POSE, NUM_PATCH)),
        np.zeros((num_scans, NUM_POSE)),
        np.zeros((size, size)),
        np.zeros(size),
    )


@kernel()
def linearise(blocks: Blocks, T: Float, planes: Float, origins: Float, out: Equations) -> None:
    """Writes the equations at poses T (N, 3, 4) and planes (P, 4)."""
    J, MJ, B = np.empty((4, NUM_COLUMNS)), np.empty((4, NUM_COLUMNS)), np.empty((3, 2))
    N = np.empty((NUM_COLUMNS, NUM_COLUMNS))
    out.pose[:], out.pose_gradient[:], out.patch[:], out.patch_gradient[:] = 0.0, 0.0, 0.0, 0.0
    first, last = NUM_POSE, NUM_POSE + NUM_PATCH
    for k in range(len(blocks.scans)):
        i, j = blocks.scans[k], blocks.patches[k]
        tangents(planes[j, :3], B)
        pose_columns(T[i], planes[j], J)
        patch_columns(T[i], B, origins[j], J)
        N[:] = 0.0
        add_products(blocks.moments[k], J, 0, MJ, N)
        chi2 = N[ALPHA, ALPHA] / blocks.num_points[k]
        if chi2 > _USUAL_CHI2:
            N *= _USUAL_CHI2 / chi2
        out.pose[i] += N[:first, :first]
        out.pose_gradient[i] += N[:first, ALPHA]
        out.patch[j] += N[first:last, first:last]
        out.patch_gradient[j] += N[first:last, ALPHA]
        out.coupling[k] = N[:first, first:last]


@kernel()
def _begin_reduced(out: Equations) -> None:
    out.reduced[:] = 0.0
    for j in range(len(out.patch)):
        for r in range(NUM_PATCH):
            out.reduced_gradient[NUM_PATCH * j + r] = out.patch_gradient[j, r]
            for c in range(NUM_PATCH):
                out.reduced[NUM_PATCH * j + r, NUM_PATCH * j + c] = out.patch[j, r, c]
            out.reduced[NUM_PATCH * j + r, NUM_PATCH * j + r] += _PATCH_HELD


@kernel()
def _solve_pose(out: Equations, i: int, first: int, after: int) -> None:
    """The inverse of pose i's block times its gradient and its couplings, which are blocks first to after - 1."""
    L, x = out.pose[i].copy(), np.empty(NUM_POSE)
    for r in range(NUM_POSE):
        L[r, r] += _POSE_HELD
    factorise(L)
    out.pose_solved[i] = out.pose_gradient[i]
    solve_factorised(L, out.pose_solved[i])
    for k in range(first, after):
        for c in range(NUM_PATCH):
            x[:] = out.coupling[k, :, c]
            solve_factorised(L, x)
            out.solved[k, :, c] = x


@lean_kernel(fastmath={"contract", "reassoc", "nsz"})
def _subtract_pair(W: Float, Y: Float, S: Float, row: int, column: int) -> None:
    """S -= W^T Y, both (6, 3), at (row, column)."""
    for r in range(NUM_PATCH):
        for c in range(NUM_PATCH):
            total = 0.0
            for p in range(NUM_POSE):
                total += W[p, r] * Y[p, c]
            S[row + r, column + c] -= total


@kernel()
def eliminate_poses(blocks: Blocks, starts: Int, out: Equations) -> None:
    """Writes the equations of the patches alone. The first pose is held. starts (N + 1,): of each scan's blocks."""
    _begin_reduced(out)
    for i in range(1, len(out.pose)):
        first, after = starts[i], starts[i + 1]
        _solve_pose(out, i, first, after)
        for k in range(first, after):
            row = NUM_PATCH * blocks.patches[k]
            for r in range(NUM_PATCH):
                out.reduced_gradient[row + r] -= np.sum(out.coupling[k, :, r] * out.pose_solved[i])
            for m in range(first, after):
                _subtract_pair(out.coupling[k], out.solved[m], out.reduced, row, NUM_PATCH * blocks.patches[m])


@kernel()
def _step_plane(plane: Float, origin: Float, step: Float, B: Float) -> None:
    """Tilts a plane (4,) about its origin by step[0:2] along its tangents, and moves it by step[2]."""
    offset = plane[0] * origin[0] + plane[1] * origin[1] + plane[2] * origin[2] + plane[3] + step[2]
    tangents(plane[:3], B)
    for r in range(3):
        plane[r] += B[r, 0] * step[0] + B[r, 1] * step[1]
    length = np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    for r in range(3):
        plane[r] /= length
    plane[3] = offset / length - (plane[0] * origin[0] + plane[1] * origin[1] + plane[2] * origin[2])


@kernel()
def substitute(
    blocks: Blocks, starts: Int, equations: Equations, steps: Float, T: Float, planes: Float, origins: Float
) -> float:
    """Moves patches by steps (3P,) and poses by what follows from that; returns the largest step of a pose."""
    largest, B = 0.0, np.empty((3, 2))
    for i in range(1, len(T)):
        x = -equations.pose_solved[i]
        for k in range(starts[i], starts[i + 1]):
            j = NUM_PATCH * blocks.patches[k]
            for r in range(NUM_POSE):
                x[r] -= np.sum(equations.solved[k, r] * steps[j : j + NUM_PATCH])
        step_pose(T[i], x)
        largest = max(largest, np.max(np.abs(x)))
    for j in range(len(planes)):
        _step_plane(planes[j], origins[j], steps[NUM_PATCH * j : NUM_PATCH * (j + 1)], B)
    return largest
