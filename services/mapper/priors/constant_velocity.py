"""The sensor goes on as it moved between the last two scans."""

from __future__ import annotations

import numpy as np

from shared.geometry import SE3, Float
from shared.motion import Motion

_STEP_RAD = 0.05
"""A motion is told in steps of at most this angle: between them it is straight, not on the arc it is meant to be on."""


class ConstantVelocity:
    """Begins at rest; after a lost scan it is at rest again, so that the estimate does not run away."""

    def __init__(self) -> None:
        self._stamp_ns: int | None = None
        self._T_map_sensor = SE3.identity()
        self.twist_per_s = np.zeros(6)

    def motion(self, start_ns: int, end_ns: int) -> Motion | None:
        """T_map_sensor from the last corrected pose on; None before the first."""
        if self._stamp_ns is None:
            return None
        angle_rad = float(np.linalg.norm(self.twist_per_s[3:])) * (end_ns - start_ns) * 1e-9
        num = 2 + int(min(angle_rad, np.pi) / _STEP_RAD)
        stamps_ns = np.unique(np.linspace(start_ns, end_ns, num).astype(np.int64))
        poses = [self._pose(stamp_ns).xyz_quat_xyzw for stamp_ns in stamps_ns.tolist()]
        return Motion(stamps_ns, np.array(poses)[:, np.newaxis])

    def step(self, start_ns: int, end_ns: int) -> SE3 | None:
        """None before the first correction."""
        return None if self._stamp_ns is None else SE3.exp(self.twist_per_s * ((end_ns - start_ns) * 1e-9))

    def correct(self, stamp_ns: int, T_map_sensor: SE3 | None) -> None:
        """Takes the velocity since the last correction that was a pose."""
        if T_map_sensor is None:
            self.twist_per_s = np.zeros(6)
            return
        if self._stamp_ns is not None and stamp_ns > self._stamp_ns:
            step = self._T_map_sensor.inv() @ T_map_sensor
            self.twist_per_s = step.log() / ((stamp_ns - self._stamp_ns) * 1e-9)
        self._stamp_ns, self._T_map_sensor = stamp_ns, T_map_sensor

    def suppose(self, stamp_ns: int, T_map_sensor: SE3) -> Float:
        """Goes from the last corrected pose to this one, which is later, until the next correction.

        Returns by how much the velocity (6,) changed, per second.
        """
        assert self._stamp_ns is not None
        before = self.twist_per_s
        step = self._T_map_sensor.inv() @ T_map_sensor
        self.twist_per_s = step.log() / ((stamp_ns - self._stamp_ns) * 1e-9)
        return self.twist_per_s - before

    def _pose(self, stamp_ns: int) -> SE3:
        assert self._stamp_ns is not None
        return self._T_map_sensor @ SE3.exp(self.twist_per_s * ((stamp_ns - self._stamp_ns) * 1e-9))
