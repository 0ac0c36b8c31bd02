"""The sensor turns as its gyroscope says, and moves on as it did between the last two scans.

The accelerometer is not used: over the tenth of a second between two scans, its bias alone moves the sensor less than
scans find, but the direction of gravity would have to be known to a milliradian for its signal to help.
"""

from __future__ import annotations

from bisect import bisect_left

import numpy as np

from services.mapper.priors.interface import step_of
from shared.geometry import SE3, Float, homogeneous
from shared.messaging.messages import Imu
from shared.motion import Motion

_KEPT_NS = 3_000_000_000
_MAX_READINGS = 10_000
"""As many as an IMU of a kilohertz says in all that time: stamps may be a nanosecond apart."""
_MAX_GAP_NS = 60_000_000
"""Readings that miss so much of an interval say nothing of it: an IMU of the simulation is two of its periods late."""
_BIAS_GAIN = 0.1
"""How much of what a scan shows of the gyroscope's bias is believed."""


class Inertial:
    """Gyroscope readings are in the sensor's frame. Their bias is learnt from where registration finds the sensor."""

    def __init__(self) -> None:
        self._stamps_ns: list[int] = []
        self._rates: list[Float] = []
        self._bias_radps = np.zeros(3)
        self._found: tuple[int, SE3] | None = None
        self._velocity_mps = np.zeros(3)

    def add_imu(self, imu: Imu) -> None:
        """Takes a reading; one that is not later than the last begins anew."""
        if self._stamps_ns and imu.stamp_ns <= self._stamps_ns[-1]:
            self._stamps_ns, self._rates = [], []
        self._stamps_ns.append(imu.stamp_ns)
        self._rates.append(imu.angular_velocity_radps)
        if imu.stamp_ns - self._stamps_ns[0] > 2 * _KEPT_NS or len(self._rates) > _MAX_READINGS:
            kept = max(bisect_left(self._stamps_ns, imu.stamp_ns - _KEPT_NS), len(self._rates) - _MAX_READINGS // 2)
            del self._stamps_ns[:kept], self._rates[:kept]

    def motion(self, start_ns: int, end_ns: int) -> Motion | None:
        """From a pose at the origin on; None before the first correction, or where readings are missing."""
        if self._found is None or not self._covers(start_ns, end_ns):
            return None
        inner = [stamp for stamp in self._stamps_ns if start_ns < stamp < end_ns]
        stamps_ns = [start_ns, *inner, *([end_ns] if end_ns > start_ns else [])]
        found_ns, found = self._found
        to_start = self._turn(found_ns, start_ns) if found_ns <= start_ns else self._turn(start_ns, found_ns).T
        R_map_start = found.rotation @ to_start
        rotation, poses = np.eye(3), []
        for before_ns, stamp_ns in zip([start_ns, *stamps_ns], stamps_ns, strict=False):
            rotation = rotation @ self._turn(before_ns, stamp_ns)
            shift_m = self._velocity_mps @ R_map_start * ((stamp_ns - start_ns) * 1e-9)
            poses.append(SE3.projected(homogeneous(rotation, shift_m)).xyz_quat_xyzw)
        return Motion(stamps_ns, np.array(poses)[:, np.newaxis])

    def step(self, start_ns: int, end_ns: int) -> SE3 | None:
        """From `motion`."""
        return step_of(self.motion, start_ns, end_ns)

    def correct(self, stamp_ns: int, T_map_sensor: SE3 | None) -> None:
        """Learns velocity and bias since the last correction."""
        if T_map_sensor is None:
            self._velocity_mps = np.zeros(3)
            return
        if self._found is not None and stamp_ns > self._found[0]:
            before_ns, before = self._found
            elapsed_s = (stamp_ns - before_ns) * 1e-9
            self._velocity_mps = (T_map_sensor.translation - before.translation) / elapsed_s
            if self._covers(before_ns, stamp_ns):
                turned = SE3.projected(homogeneous(self._turn(before_ns, stamp_ns), np.zeros(3)))
                true = SE3(before.rotation.T @ T_map_sensor.rotation, np.zeros(3))
                self._bias_radps = self._bias_radps + _BIAS_GAIN * (true.inv() @ turned).log()[3:] / elapsed_s
        self._found = (stamp_ns, T_map_sensor)

    def _covers(self, start_ns: int, end_ns: int) -> bool:
        stamps = self._stamps_ns
        return bool(stamps) and stamps[0] <= start_ns + _MAX_GAP_NS and stamps[-1] >= end_ns - _MAX_GAP_NS

    def _turn(self, start_ns: int, end_ns: int) -> Float:
        """Rotation (3, 3) of the sensor over this time; each reading holds until halfway to its neighbours."""
        first = max(bisect_left(self._stamps_ns, start_ns) - 1, 0)
        last = min(bisect_left(self._stamps_ns, end_ns) + 1, len(self._stamps_ns))
        stamps = np.array(self._stamps_ns[first:last])
        borders = np.concatenate([[start_ns], np.clip((stamps[:-1] + stamps[1:]) // 2, start_ns, end_ns), [end_ns]])
        rotation = np.eye(3)
        for rate, duration_ns in zip(self._rates[first:last], np.diff(borders).tolist(), strict=True):
            if duration_ns:
                turn = (rate - self._bias_radps) * (duration_ns * 1e-9)
                rotation = rotation @ SE3.exp(np.concatenate([np.zeros(3), turn])).rotation
        return rotation
