"""Clouds of steel bars, without rays: points all over the faces of boxes."""

from __future__ import annotations

import numpy as np

BARS = (
    ((0.0, 0.0, -1.2), (6.0, 0.2, 0.2)),
    ((0.0, 1.5, -1.2), (6.0, 0.2, 0.2)),
    ((-1.6, 0.7, -1.2), (0.2, 1.3, 0.2)),
    ((1.1, 0.7, -1.2), (0.15, 1.3, 0.2)),
    ((2.5, 0.0, 0.5), (0.2, 0.2, 3.2)),
    ((-2.3, 1.5, 0.2), (0.2, 0.2, 2.6)),
)
"""Centres and sizes of six bars, which look like themselves from one side only."""


def steel_cloud(seed, num=6000, noise_m=0.004, bars=BARS):
    """Points (N, 3) evenly on the faces of the bars, with noise along each axis."""
    rng = np.random.default_rng(seed)
    sizes = np.array([size for _, size in bars])
    areas = np.stack([sizes[:, 1] * sizes[:, 2], sizes[:, 2] * sizes[:, 0], sizes[:, 0] * sizes[:, 1]], axis=1)
    face = rng.choice(areas.size, num, p=(areas / areas.sum()).ravel())
    bar, axis = np.divmod(face, 3)
    unit = rng.uniform(-0.5, 0.5, (num, 3))
    unit[np.arange(num), axis] = rng.choice([-0.5, 0.5], num)
    centres = np.array([centre for centre, _ in bars])
    return centres[bar] + unit * sizes[bar] + noise_m * rng.standard_normal((num, 3))
