"""The method `global`: where the planes of scan and target fit best, whatever was predicted; then GICP."""

from __future__ import annotations

import numpy as np

from services.mapper.methods.two_step import TwoStep


class Anywhere(TwoStep):
    """For steps of any size: poses all over the target are tried. On lattices, which repeat, it may well be suspect."""

    max_angle_rad = np.pi
    max_distance_m = np.inf
    max_candidates = 8
