"""What an inertial measurement unit measures that is fixed to a frame whose true poses are known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from shared.geometry import SE3, Float
from shared.messaging.messages import Imu
from shared.robot.statics import GRAVITY_MPS2
from shared.runtime.sensor_config import ImuConfig

MAX_GAP_NS = 100_000_000
"""Across a longer gap between two poses nothing is known of what happened in it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Pose:
    stamp_ns: int
    T_world_sensor: SE3


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """From one pose to the next: mean angular velocity in the sensor's frame, mean velocity in the world's."""

    duration_s: float
    angular_velocity: Float
    velocity: Float


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """Motion at the moment of a pose: angular velocity in the sensor's frame, acceleration in the world's.

    mean_angular_velocity: until the next pose, in the sensor's frame.
    """

    stamp_ns: int
    R_world_sensor: Float
    angular_velocity: Float
    acceleration: Float
    mean_angular_velocity: Float

    def rotation(self, after_s: float) -> Float:
        """R_world_sensor so long after, before the next pose."""
        turn = SE3.exp(np.concatenate([np.zeros(3), after_s * self.mean_angular_velocity]))
        rotation: Float = self.R_world_sensor @ turn.rotation
        return rotation


class InertialUnit:
    """Fed with true poses, gives measurements at whole multiples of its own period.

    At a pose, angular velocity and acceleration are central differences over its neighbours, by their actual stamps;
    between two poses both are linear, and the rotation turns evenly. This is exact while angular velocity and
    acceleration are constant. A measurement is given with the second pose that is not before it, so one to two periods
    of the poses late. The first ones are those at the second pose. Before a gap of more than 0.1 s in the poses the
    last ones are missing; after it, or where stamps do not go forward, it begins anew, and the biases wander on.

    The white noise of a sample has the standard deviation density * sqrt(rate); a bias is drawn at the start and walks
    by density * sqrt(period) a sample. frame: of the messages. gravity_mps2: along the world's -z.
    """

    def __init__(
        self, config: ImuConfig, frame: str, rng: np.random.Generator, gravity_mps2: float = GRAVITY_MPS2
    ) -> None:
        self._rate_hz, self._frame = config.rate_hz, frame
        self._gravity = np.array([0.0, 0.0, gravity_mps2])
        self._errors = _Errors(config, rng)
        self._num_sent = 0
        self._pose: _Pose | None = None
        self._step: _Step | None = None
        self._state: _State | None = None

    def add_pose(self, stamp_ns: int, T_world_sensor: SE3) -> list[Imu]:
        """The measurements that this pose completes, oldest first; none at a rate of 0."""
        before, pose = self._pose, _Pose(stamp_ns, T_world_sensor)
        self._pose = pose
        if self._rate_hz == 0:
            return []
        if before is None or not 0 < stamp_ns - before.stamp_ns <= MAX_GAP_NS:
            self._step = self._state = None
            return []
        step_before, self._step = self._step, _step(before, pose)
        if step_before is None:
            return []
        state_before, self._state = self._state, _state(before, step_before, self._step)
        return self._measured(state_before, self._state)

    def _measured(self, start: _State | None, end: _State) -> list[Imu]:
        """Those after `start` up to `end`; without a start, the one at `end` if one is due there."""
        after_ns = end.stamp_ns - 1 if start is None else start.stamp_ns
        messages = []
        index = math.floor(after_ns * self._rate_hz * 1e-9)
        while (stamp_ns := self._stamp_ns(index)) <= end.stamp_ns:
            if stamp_ns > after_ns:
                messages.append(self._measurement(stamp_ns, start or end, end))
            index += 1
        return messages

    def _stamp_ns(self, index: int) -> int:
        return round(index * 1e9 / self._rate_hz)

    def _measurement(self, stamp_ns: int, start: _State, end: _State) -> Imu:
        duration_ns = end.stamp_ns - start.stamp_ns
        share = (stamp_ns - start.stamp_ns) / duration_ns if duration_ns else 0.0
        angular_velocity = start.angular_velocity + share * (end.angular_velocity - start.angular_velocity)
        acceleration = start.acceleration + share * (end.acceleration - start.acceleration)
        R_world_sensor = start.rotation(after_s=(stamp_ns - start.stamp_ns) * 1e-9)
        gyro_error, accel_error = self._errors.draw()
        self._num_sent += 1
        return Imu(
            stamp_ns=stamp_ns,
            seq=self._num_sent - 1,
            frame=self._frame,
            angular_velocity_radps=angular_velocity + gyro_error,
            linear_acceleration_mps2=(acceleration + self._gravity) @ R_world_sensor + accel_error,
        )


class _Errors:
    """White noise and wandering biases of gyroscope and accelerometer."""

    def __init__(self, config: ImuConfig, rng: np.random.Generator) -> None:
        self._rng = rng
        rate_hz = config.rate_hz or 1.0
        noise = (config.gyro_noise_radps_per_sqrt_hz, config.accel_noise_mps2_per_sqrt_hz)
        walk = (config.gyro_walk_radps2_per_sqrt_hz, config.accel_walk_mps3_per_sqrt_hz)
        self._noise = np.array(noise)[:, np.newaxis] * math.sqrt(rate_hz)
        self._walk = np.array(walk)[:, np.newaxis] / math.sqrt(rate_hz)
        self._bias = np.array([config.gyro_bias_radps, config.accel_bias_mps2])[:, np.newaxis] * self._normal()

    def draw(self) -> Float:
        """(2, 3): the next sample's errors, of the gyroscope in rad/s and of the accelerometer in m/s^2."""
        errors: Float = self._bias + self._noise * self._normal()
        self._bias = self._bias + self._walk * self._normal()
        return errors

    def _normal(self) -> Float:
        return self._rng.standard_normal((2, 3))


def _step(start: _Pose, end: _Pose) -> _Step:
    duration_s = (end.stamp_ns - start.stamp_ns) * 1e-9
    a, b = start.T_world_sensor, end.T_world_sensor
    return _Step(duration_s, _turn(a, b) / duration_s, (b.translation - a.translation) / duration_s)


def _state(pose: _Pose, before: _Step, after: _Step) -> _State:
    """By the parabola through three values: its slope, and its curvature, at the middle one."""
    total_s = before.duration_s + after.duration_s
    angular_velocity = before.angular_velocity * after.duration_s + after.angular_velocity * before.duration_s
    return _State(
        stamp_ns=pose.stamp_ns,
        R_world_sensor=pose.T_world_sensor.rotation,
        angular_velocity=angular_velocity / total_s,
        acceleration=2.0 * (after.velocity - before.velocity) / total_s,
        mean_angular_velocity=after.angular_velocity,
    )


def _turn(start: SE3, end: SE3) -> Float:
    """Rotation vector (3,) from one orientation to the other, in radians; the same seen from either."""
    relative = SE3(start.rotation.T @ end.rotation, np.zeros(3))
    return relative.log()[3:]
