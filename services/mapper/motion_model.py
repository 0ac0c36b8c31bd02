"""What is known of the sensor's motion besides scans: legs, IMU, trend; and what of a scan is the robot itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.body import BodyFilter
from services.mapper.postures import Mount, Postures, mount_of
from services.mapper.priors.constant_velocity import ConstantVelocity
from services.mapper.priors.inertial import Inertial
from services.mapper.priors.interface import Prior, Step
from services.mapper.priors.leg_odometry import LegOdometry
from services.mapper.registration import Points
from services.mapper.slip import Disagreement, SlipWatch
from services.mapper.state import MotionState
from services.mapper.tracking import Track
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.messaging.messages import Event, Imu, JointState, LegState, Message, RobotDescription, Severity
from shared.motion import Motion
from shared.robot.description import UrdfModel
from shared.robot.urdf import parse_urdf
from shared.runtime.config import MapperConfig

TREND = "constant_velocity"
GIVEN = "trajectory"
_BENT_M, _BENT_RAD = 0.001, 0.001
"""Half a scan that is straightened better than this is left so: below the noise of a range at any distance."""
MEASURED = ("legs", GIVEN)
"""The priors that know where the sensor goes; an IMU knows only how it turns."""


class MotionModel:
    """Asks the configured prior first, then the trend of the last scans. prior: instead of the configured one."""

    def __init__(self, config: MapperConfig, prior: Prior | None = None) -> None:
        self._config = config
        self._postures, self._imu, self._trend = Postures(), Inertial(), ConstantVelocity()
        self._legs = LegOdometry(self._postures)
        named: dict[str, Prior] = {"legs": self._legs, "imu": self._imu, TREND: self._trend}
        first = (config.prior, named[config.prior]) if prior is None else (GIVEN, prior)
        self._priors = dict([first, (TREND, self._trend)])
        self._slip = SlipWatch(config.max_leg_error_m, float(np.deg2rad(config.max_leg_error_deg)))
        self._robot: UrdfModel | None = None
        self._body: BodyFilter | None = None
        self._body_mounts: list[Mount] = []
        self._frame = ""
        self._last_ns: int | None = None

    def set_robot(self, description: RobotDescription) -> list[Message]:
        """Takes the robot's links and shapes.

        Raises:
            InputFileError: the URDF is malformed.
        """
        self._robot = parse_urdf(description.urdf, "robot_description")
        return self._mount(description.stamp_ns)

    def add_joints(self, joints: JointState) -> None:
        """Takes a reading of the encoders."""
        self._postures.add(joints)

    def add_leg_state(self, legs: LegState) -> None:
        """Takes which foot is fixed."""
        self._legs.add_leg_state(legs)

    def add_imu(self, imu: Imu) -> None:
        """Takes a reading of the sensor's own IMU."""
        self._imu.add_imu(imu)

    def begin(self, stamp_ns: int, frame: str) -> list[Message]:
        """Before each scan: when it begins and in which frame it is; time that goes back begins anew."""
        if self._last_ns is not None and stamp_ns < self._last_ns:
            self._last_ns = None
            self._slip.forget()
            self._trend = self._priors[TREND] = ConstantVelocity()
        if frame == self._frame:
            return []
        self._frame = frame
        return self._mount(stamp_ns)

    def snapshot(self) -> MotionState:
        """What the way on from the last scan follows from, where the legs know it."""
        readings = self._postures.snapshot(self._last_ns or 0)
        return MotionState(last_ns=self._last_ns, readings=readings, legs=self._legs.snapshot())

    def restore(self, state: MotionState) -> None:
        """Goes on from the last scan; of velocities nothing is known.

        Raises:
            ValueError: it is no such state; nothing has changed.
        """
        self._legs.restore(state.legs)
        self._postures.restore(state.readings)
        self._last_ns = state.last_ns

    def during(self, start_ns: int, end_ns: int) -> Motion | None:
        """The sensor's motion over this time; None where nothing is known of it."""
        motions = (prior.motion(start_ns, end_ns) for prior in self._priors.values())
        return next((motion for motion in motions if motion is not None), None)

    def step(self, stamp_ns: int) -> Step:
        """From the last scan to this one; none at the first scan, or where nothing is known."""
        if self._last_ns is not None:
            for name, prior in self._priors.items():
                T_last_now = prior.step(self._last_ns, stamp_ns)
                if T_last_now is not None:
                    return Step(T_last_now, name, is_measured=name in MEASURED)
        return Step(SE3.identity(), TREND, is_measured=False)

    def suppose(self, stamp_ns: int, T_map_sensor: SE3, duration_ns: int) -> bool:
        """Takes the trend to lead to where a scan, begun with a trend that may be wrong, was found at first.

        Returns whether a scan that takes so long is bent otherwise than was thought, and to be straightened anew.
        """
        if self._last_ns is None or stamp_ns <= self._last_ns:
            return False
        change = self._trend.suppose(stamp_ns, T_map_sensor) * (duration_ns * 0.5e-9)
        return bool(np.linalg.norm(change[:3]) > _BENT_M or np.linalg.norm(change[3:]) > _BENT_RAD)

    def back(self, stamp_ns: int, to_ns: int) -> SE3:
        """T_now_then: the sensor at an earlier time seen from itself; the identity where nothing is known."""
        steps = (prior.step(stamp_ns, to_ns) for prior in self._priors.values())
        return next((step for step in steps if step is not None), SE3.identity())

    def correct(self, stamp_ns: int, T_map_sensor: SE3 | None) -> None:
        """Where registration found the sensor; None: it was lost."""
        self._last_ns = stamp_ns
        for prior in self._priors.values():
            prior.correct(stamp_ns, T_map_sensor)

    def slip(self, stamp_ns: int, track: Track) -> Disagreement | None:
        """How far legs and scans disagree over the last second; None where one of them does not know."""
        if track.is_found_again or not track.is_tracking:
            self._slip.forget()
        return self._slip.compare(stamp_ns, track.T_map_sensor, self._legs) if track.is_tracking else None

    def is_slip(self, found: Disagreement | None) -> bool:
        """Whether it is more than encoders explain; a slip is told once."""
        return found is not None and self._slip.is_slip(found)

    def body_mask(self, points_m: Points, stamp_ns: int) -> NDArray[np.bool_] | None:
        """Which points (N, 3), in the sensor's frame, are on the robot; None where its posture is not known."""
        if self._body is None or not self._config.body or not self._postures.knows(stamp_ns, stamp_ns):
            return None
        links = self._postures.links([stamp_ns])
        T_sensor_footA = np.linalg.inv(self._postures.sensor(links)[0])
        T_footA_link = np.array([links[0, mount.link] @ mount.T_link_frame.matrix for mount in self._body_mounts])
        return self._body.on_body(points_m, T_sensor_footA @ T_footA_link)

    def _mount(self, stamp_ns: int) -> list[Message]:
        if self._robot is None or not self._frame:
            return []
        try:
            self._postures.mount = mount_of(self._robot, self._frame)
            self._body = BodyFilter(self._robot.shapes)
            self._body_mounts = [mount_of(self._robot, link) for link in self._body.links]
        except InputFileError as error:
            text = f"maps without legs: {error}"
            return [Event(stamp_ns=stamp_ns, seq=0, frame="", source="mapper", severity=Severity.WARNING, text=text)]
        return []
