"""A camera without distortion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Pinhole:
    """Size and intrinsics in pixels. Optical frame of REP-103: z forward, x right, y down.

    The centre of the top left pixel is at (0, 0), as in sensor_msgs/CameraInfo.
    """

    height: int
    width: int
    fx: float
    fy: float
    cx: float
    cy: float

    def rays(self) -> NDArray[np.float64]:
        """Through the centre of each pixel (H, W, 3), of depth 1."""
        u = (np.arange(self.width) - self.cx) / self.fx
        v = (np.arange(self.height) - self.cy) / self.fy
        x, y = np.meshgrid(u, v)
        return np.stack([x, y, np.ones_like(x)], axis=-1)
