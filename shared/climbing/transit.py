"""The way from posture to posture: a straight line in joint space, in samples close enough to miss nothing."""

from __future__ import annotations

import math

import numpy as np

from shared.climbing.bodies import Bodies
from shared.climbing.stance import Stance
from shared.geometry import Float

_NUM_COARSE = 17
_MAX_SAMPLES = 20_000
"""Twice what the longest way within the joint limits takes: a file in degrees shall not take all memory."""
_PEAK = 1.05
"""A point may be so much faster than on the mean of its fastest coarse piece."""


def line_samples(q_start: Float, q_end: Float, stance: Stance, bodies: tuple[Bodies, ...], step_m: float) -> Float:
    """Postures (S, 8) from `q_start` to `q_end`, both included; from one to the next no point moves over `step_m`."""
    shares = np.linspace(0.0, 1.0, _NUM_COARSE)[:, None]
    coarse = q_start + shares * (q_end - q_start)
    T = stance.T_world_links(coarse)
    fastest_m = 0.0
    for kind in bodies:
        T_world_body = T[:, kind.chain]
        corners = kind.corners_m() @ T_world_body[..., :3, :3].swapaxes(-1, -2) + T_world_body[..., None, :3, 3]
        fastest_m = max(fastest_m, float(np.linalg.norm(np.diff(corners, axis=0), axis=-1).max()))
    num = min(max(1, math.ceil(_PEAK * fastest_m * (_NUM_COARSE - 1) / step_m)), _MAX_SAMPLES)
    samples: Float = q_start + np.linspace(0.0, 1.0, num + 1)[:, None] * (q_end - q_start)
    return samples
