"""The mapper's facade: measurements in; odometry, status, map and planes out. It sees no truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from services.mapper.degeneracy import covariance
from services.mapper.filters import ScanFilter
from services.mapper.measured import Measured, Points, Registered as Registered
from services.mapper.motion_model import TREND, MotionModel
from services.mapper.plane_map import plane_map
from services.mapper.priors.interface import Prior, Step
from services.mapper.reports import Reports
from services.mapper.state import MapState, PoseState
from services.mapper.target import Target
from services.mapper.tracking import Track
from shared.depth_points import points_of
from shared.deskew import deskewed
from shared.messaging.messages import (
    CameraInfo,
    DepthImage,
    Imu,
    JointState,
    LegState,
    LidarScan,
    MapStatus,
    Message,
    Odometry,
    PlaneMap,
    PointCloud,
    RobotDescription,
)
from shared.messaging.sequence import SequenceCounter
from shared.runtime.config import MapperConfig

MAP_FRAME = "map"
_KINDS: tuple[type[Message], ...] = (Odometry, MapStatus, PointCloud, PlaneMap)
"""What is numbered, in the order in which a snapshot counts it."""


class Mapper:
    """Online odometry and mapping with one sensor; the map frame is the sensor's frame at the first usable scan.

    When stamps go back, the run was started again: it goes on where the map began, or, if the scan does not fit there,
    with a new map. clock_ns: monotonic, only to say how long a scan took; by default it says 0. prior: instead of the
    configured one. loaded_map_m: points (N, 3) of a map to begin with, whose frame is then the map's.
    """

    def __init__(
        self,
        config: MapperConfig,
        clock_ns: Callable[[], int] = lambda: 0,
        *,
        prior: Prior | None = None,
        loaded_map_m: NDArray[np.float64] | None = None,
    ) -> None:
        self._config = config
        self._clock_ns = clock_ns
        self._motion = MotionModel(config, prior)
        self._filter = ScanFilter(config)
        self._target = Target(config, loaded_map_m)
        self._scans = SequenceCounter()
        self._reports = Reports()
        self._camera: CameraInfo | None = None
        self.last: Registered | None = None
        """The last scan."""
        self._stamp_ns = 0
        self._num_sent: dict[type[Message], int] = {}
        self._map_period = -1

    # ---- what predicts the motion

    def set_robot(self, description: RobotDescription) -> list[Message]:
        """Takes the robot's links, for legs and body; a robot that does not carry the sensor is not used."""
        return self._motion.set_robot(description)

    def add_joints(self, joints: JointState) -> list[Message]:
        """Takes a reading of the encoders."""
        self._motion.add_joints(joints)
        return []

    def add_leg_state(self, legs: LegState) -> list[Message]:
        """Takes which foot is fixed. Where it stands in the world is not looked at."""
        self._motion.add_leg_state(legs)
        return []

    def add_imu(self, imu: Imu) -> list[Message]:
        """Takes a reading of the sensor's own IMU."""
        self._motion.add_imu(imu)
        return []

    # ---- what is mapped

    def add_scan(self, scan: LidarScan, received_ns: int = 0) -> list[Message]:
        """Registers a scan and takes it into the map.

        received_ns: when the scan was received, on the clock of `clock_ns`. Returns a status, odometry once there is a
        map, events, and map and planes at their rate in simulated time.
        """
        started_ns = self._clock_ns()
        said = self._begin(scan.stamp_ns, scan.frame)
        points_m, taken_ns = self._straightened(scan)
        if taken_ns != scan.stamp_ns and self._is_bent_otherwise(scan, points_m, taken_ns):
            points_m, taken_ns = self._straightened(scan)
        measured = Measured(points_m, taken_ns, scan.seq, scan.frame, started_ns, received_ns)
        return [*said, *self._add(measured)]

    def set_camera(self, info: CameraInfo) -> list[Message]:
        """Takes the intrinsics of the images that follow."""
        self._camera = info
        return []

    def add_image(self, image: DepthImage, received_ns: int = 0) -> list[Message]:
        """Registers a depth image as a scan; nothing follows before the camera is known. See `add_scan`."""
        camera = self._camera
        if camera is None:
            return []
        started_ns = self._clock_ns()
        said = self._begin(image.stamp_ns, image.frame)
        depth_mm = image.depth_mm.reshape(image.height, image.width)
        points_m = points_of(depth_mm, camera.fx, camera.fy, camera.cx, camera.cy, self._config.depth_stride)
        measured = Measured(points_m, image.stamp_ns, image.seq, image.frame, started_ns, received_ns)
        return [*said, *self._add(measured)]

    def map_cloud(self) -> PointCloud:
        """The map as it is now."""
        return PointCloud(
            stamp_ns=self._stamp_ns,
            seq=self._next_seq(PointCloud),
            frame=MAP_FRAME,
            points_m=self._target.points_m.astype(np.float32),
        )

    def map_planes(self) -> PlaneMap:
        """The map's planes as they are now; none with methods that know none."""
        return plane_map(self._target.matcher, self._stamp_ns, self._next_seq(PlaneMap), MAP_FRAME)

    # ---- going on after a death

    def pose_snapshot(self) -> PoseState | None:
        """Where it is and what it has said; None before there is a map."""
        if (track := self._target.snapshot()) is None:
            return None
        last_seq = -1 if self._scans.last_seq is None else self._scans.last_seq
        return PoseState(
            stamp_ns=self._stamp_ns,
            map_period=self._map_period,
            num_sent=np.array([self._num_sent.get(kind, 0) for kind in _KINDS]),
            scans=np.array([last_seq, self._scans.num_received, self._scans.num_missed]),
            track=track,
            motion=self._motion.snapshot(),
        )

    def map_snapshot(self) -> MapState | None:
        """The map; None before there is one."""
        return self._target.map_snapshot(self._stamp_ns)

    def restore(self, pose: PoseState, known: MapState) -> list[Message]:
        """Goes on in the map of another that was killed: the next scan is looked for where the legs say, or near.

        Raises:
            ValueError, RegistrationError: they cannot be states of these settings.
        """
        num_sent = dict(zip(_KINDS, pose.num_sent.tolist(), strict=True))
        self._target.restore(pose.track, known)
        self._motion.restore(pose.motion)
        last_seq, num_received, num_missed = pose.scans.tolist()
        self._scans = SequenceCounter(None if last_seq < 0 else last_seq, num_received, num_missed)
        self._num_sent, self._stamp_ns, self._map_period = num_sent, pose.stamp_ns, pose.map_period
        return [self._reports.restored(pose.stamp_ns, pose.stamp_ns - known.stamp_ns, self._target.num_points)]

    @property
    def target(self) -> Target:
        """The map that scans are aligned to."""
        return self._target

    # ---- one scan, step by step

    def _begin(self, stamp_ns: int, frame: str) -> list[Message]:
        if stamp_ns < self._stamp_ns:
            self._target.restart()
            self._reports.restart()
        self._stamp_ns = stamp_ns
        return self._motion.begin(stamp_ns, frame)

    def _straightened(self, scan: LidarScan) -> tuple[Points, int]:
        """The points as if all were measured at one time, and that time: the middle of the scan.

        An error of the velocity then moves the first and the last points to opposite sides, and the pose hardly. At the
        first scan, whose pose is the map's frame, it is the beginning.
        """
        if not self._config.deskew or not scan.t_ns.any():
            return scan.points_m, scan.stamp_ns
        last_ns = scan.stamp_ns + int(scan.t_ns.max())
        taken_ns = (scan.stamp_ns + last_ns) // 2 if self._target.has_begun else scan.stamp_ns
        motion = self._motion.during(scan.stamp_ns, last_ns)
        return (scan.points_m if motion is None else deskewed(scan, motion, taken_ns)), taken_ns

    def _is_bent_otherwise(self, scan: LidarScan, points_m: Points, taken_ns: int) -> bool:
        """Whether a scan that was straightened by a mere trend shows that the sensor moved otherwise."""
        step = self._motion.step(taken_ns)
        if step.prior != TREND:
            return False
        found = self._target.look(self._filter.filtered(points_m).points_m, step)
        return found is not None and self._motion.suppose(taken_ns, found, 2 * (taken_ns - scan.stamp_ns))

    def _add(self, measured: Measured) -> list[Message]:
        taken_ns = measured.taken_ns
        self._scans.add(measured.seq)
        is_body = self._motion.body_mask(measured.points_m, taken_ns)
        points_m = self._filter.filtered(measured.points_m, is_body).points_m
        step = self._motion.step(taken_ns)
        track = self._target.follow(points_m, step)
        registered_ns = self._clock_ns()
        self._target.add_to_cloud(points_m, track)
        self.last = Registered(points_m, track.T_map_sensor, track.is_tracking)
        self._motion.correct(taken_ns, track.T_map_sensor if track.is_tracking else None)
        slip = self._motion.slip(taken_ns, track)
        is_slip = self._motion.is_slip(slip)
        times = {
            "registration_ms": (registered_ns - measured.started_ns) / 1e6,
            "lag_ms": (self._clock_ns() - measured.received_ns) / 1e6,
        }
        status = self._status(measured.seq, track, step, slip.distance_m if slip else None, times)
        odometry = [self._odometry(measured, track)] if self._target.has_begun else []
        return [*odometry, status, *self._reports.events(status, track, slip if is_slip else None), *self._due_map()]

    def _odometry(self, measured: Measured, track: Track) -> Odometry:
        """At the scan's own stamp, from where it was taken."""
        T_map_sensor = track.T_map_sensor
        if measured.taken_ns != self._stamp_ns:
            T_map_sensor = T_map_sensor @ self._motion.back(measured.taken_ns, self._stamp_ns)
        return Odometry(
            stamp_ns=self._stamp_ns,
            seq=self._next_seq(Odometry),
            frame=MAP_FRAME,
            child_frame=estimated_frame(measured.frame),
            T_frame_child=T_map_sensor.xyz_quat_xyzw,
            covariance=covariance(track.result) if track.is_tracking and track.result is not None else None,
        )

    def _status(
        self, seq: int, track: Track, step: Step, leg_slip_m: float | None, times: dict[str, float]
    ) -> MapStatus:
        result = track.result
        return MapStatus(
            stamp_ns=self._stamp_ns,
            seq=self._next_seq(MapStatus),
            frame=MAP_FRAME,
            scan_seq=seq,
            method=self._config.method,
            prior=step.prior,
            is_tracking=track.is_tracking,
            is_suspect=bool(result and result.is_suspect),
            **times,
            num_iterations=result.num_iterations if result else 0,
            num_points=result.num_points if result else 0,
            num_inliers=result.num_inliers if result else 0,
            score=result.score if result else 0.0,
            fitness=result.fitness_m2 if result else None,
            degenerate_axes=track.degenerate_axes,
            num_map_points=self._target.num_points,
            num_scans_missed=self._scans.num_missed,
            num_lost_scans=self._target.num_lost_scans,
            leg_slip_m=leg_slip_m,
        )

    def _due_map(self) -> list[Message]:
        period = int(self._stamp_ns * 1e-9 * self._config.map_rate_hz)
        if not self._target.has_begun or period == self._map_period:
            return []
        self._map_period = period
        return [self.map_cloud(), self.map_planes()]

    def _next_seq(self, kind: type[Message]) -> int:
        self._num_sent[kind] = self._num_sent.get(kind, 0) + 1
        return self._num_sent[kind] - 1


def estimated_frame(sensor_frame: str) -> str:
    """What the sensor's frame is called where its pose is an estimate."""
    return f"{sensor_frame.removesuffix('_optical')}_estimated"
