"""Moves a pose onto the map from nearby: wide gates first, then those of the noise, then patches and pose together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.mapper.planes.association import Association, associate, associate_wide
from services.mapper.planes.gauss_newton import gauss_newton, orthonormalise
from services.mapper.planes.patches import PatchArrays
from services.mapper.planes.runs import Runs
from services.mapper.planes.voxel_table import VoxelTable
from shared.kernel import kernel

Float = NDArray[np.float64]

_MAX_PASSES = 4
_WIDE_STRIDE = 8
_FINE_STRIDE = 2
_WIDE_STEP = 2e-3
_FINE_STEP = 1e-3
"""A step (metres, radians) below these ends a stage: the next one goes on from there."""
_LAST_STEPS = 3


class Target(NamedTuple):
    """What a scan is aligned to."""

    narrow: VoxelTable
    wide: VoxelTable
    patches: PatchArrays


class Counts(NamedTuple):
    """Points that the map explains, those it contradicts, all that were looked at; steps taken to get there."""

    num_explained: int
    num_contradicted: int
    num_points: int
    num_steps: int

    @property
    def agreement(self) -> float:
        """Explained points as a share of those of which the map says anything: 0..1."""
        return self.num_explained / max(self.num_explained + self.num_contradicted, 1)

    @property
    def gain(self) -> float:
        """Explained less contradicted points as a share of all: -1..1. A look-alike of the place explains fewer."""
        return (self.num_explained - self.num_contradicted) / max(self.num_points, 1)


@kernel()
def approach(runs: Runs, T: Float, target: Target, gate_m: float, stride: int, found: Association) -> Counts:
    """Moves T (3, 4) from within `gate_m` of the map onto it. stride: of the runs, as a multiple of the usual."""
    num_steps = 0
    for _ in range(_MAX_PASSES):
        num_steps += 1
        associate_wide(runs, _WIDE_STRIDE * stride, T, target.wide, target.patches.planes, gate_m, found)
        if gauss_newton(T, found, target.patches, 2, False, 1e-4) < _WIDE_STEP:
            break
    explained, contradicted, num = 0, 0, 0
    for _ in range(_MAX_PASSES):
        num_steps += 1
        explained, contradicted, num = associate(
            runs, _FINE_STRIDE * stride, T, target.narrow, target.patches.planes, found
        )
        if gauss_newton(T, found, target.patches, 3, False, 0.0) < _FINE_STEP:
            break
    return Counts(explained, contradicted, num, num_steps)


@kernel()
def finish(runs: Runs, T: Float, target: Target, found: Association) -> tuple[Counts, float]:
    """Moves T (3, 4), which is near, by all runs with the patches free; returns the last step in metres, radians.

    The rotation does not drift from scan to scan.
    """
    explained, contradicted, num = associate(runs, 1, T, target.narrow, target.patches.planes, found)
    step, num_steps = 1.0, 0
    for _ in range(_LAST_STEPS):
        num_steps += 1
        step = gauss_newton(T, found, target.patches, 5, True, 0.0)
        if step < 2e-6:
            break
    orthonormalise(T)
    return Counts(explained, contradicted, num, num_steps), step
