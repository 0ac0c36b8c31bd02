"""The mapper's facade: scans in; odometry, status and map out. It sees no truth, and its time is that of the scans."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from services.mapper.filters import thinned
from services.mapper.keyframe_map import KeyframeMap
from services.mapper.tracking import MIN_POINTS, Track, Tracker
from services.mapper.uncertainty import covariance, degenerate_axes
from shared.geometry import SE3
from shared.messaging.messages import LidarScan, MapStatus, Message, Odometry, PointCloud
from shared.messaging.sequence import SequenceCounter
from shared.runtime.config import MapperConfig

MAP_FRAME = "map"
ESTIMATED_FRAME = "lidar_estimated"


class Mapper:
    """Online odometry and mapping; the map frame is the lidar's frame at the first usable scan.

    When stamps go back, the run was started again: it goes on where the map began, or, if the scan does not fit there,
    with a new map. clock_ns: monotonic, only to say how long a scan took.
    """

    def __init__(self, config: MapperConfig, clock_ns: Callable[[], int]) -> None:
        self._config = config
        self._clock_ns = clock_ns
        self._cloud_period_ns = round(1e9 / config.map_rate_hz)
        self._map: KeyframeMap | None = None
        self._tracker = Tracker(config, stamp_ns=0)
        self._scans = SequenceCounter()
        self._stamp_ns = 0
        self._cloud_period = -1
        self._num_clouds = self._num_odometry = self._num_statuses = 0

    def add_scan(self, scan: LidarScan, received_ns: int) -> list[Message]:
        """Registers a scan, and adds it to the map where the lidar has moved on.

        received_ns: when the scan was received, on the clock of `clock_ns`. Returns a status, odometry once there is a
        map, and the map itself at its rate in simulated time.
        """
        started_ns = self._clock_ns()
        self._scans.add(scan.seq)
        points_lidar_m = thinned(scan.points_m, self._config)
        track = self._track(points_lidar_m, scan.stamp_ns)
        registered_ns = self._clock_ns()
        if self._map is not None and track.is_tracking:
            self._map.add(points_lidar_m, track.T_map_lidar)
        times = {
            "registration_ms": (registered_ns - started_ns) / 1e6,
            "lag_ms": (self._clock_ns() - received_ns) / 1e6,
        }
        odometry = [] if self._map is None else [self._odometry(scan, track)]
        return [*odometry, self._status(scan, track, **times), *self._due_cloud()]

    def map_cloud(self) -> PointCloud:
        """The map as it is now."""
        points_m = np.empty((0, 3)) if self._map is None else self._map.points_m
        self._num_clouds += 1
        return PointCloud(
            stamp_ns=self._stamp_ns, seq=self._num_clouds - 1, frame=MAP_FRAME, points_m=points_m.astype(np.float32)
        )

    def _track(self, points_lidar_m: NDArray[np.float64], stamp_ns: int) -> Track:
        is_restart = stamp_ns < self._stamp_ns
        self._stamp_ns = stamp_ns
        if is_restart:
            self._tracker = Tracker(self._config, stamp_ns)
        if self._map is not None:
            track = self._tracker.follow(points_lidar_m, stamp_ns, self._map.registration)
            if track.is_tracking or not is_restart:
                return track
        if len(points_lidar_m) < MIN_POINTS:
            return Track(SE3.identity(), False, None)
        self._map = KeyframeMap(points_lidar_m, self._config)
        self._tracker = Tracker(self._config, stamp_ns)
        return Track(SE3.identity(), True, None)

    def _odometry(self, scan: LidarScan, track: Track) -> Odometry:
        self._num_odometry += 1
        return Odometry(
            stamp_ns=scan.stamp_ns,
            seq=self._num_odometry - 1,
            frame=MAP_FRAME,
            child_frame=ESTIMATED_FRAME,
            T_frame_child=track.T_map_lidar.xyz_quat_xyzw,
            covariance=covariance(track.result) if track.is_tracking and track.result is not None else None,
        )

    def _status(self, scan: LidarScan, track: Track, *, registration_ms: float, lag_ms: float) -> MapStatus:
        result = track.result
        self._num_statuses += 1
        return MapStatus(
            stamp_ns=scan.stamp_ns,
            seq=self._num_statuses - 1,
            frame=MAP_FRAME,
            scan_seq=scan.seq,
            method=self._config.method,
            is_tracking=track.is_tracking,
            registration_ms=registration_ms,
            lag_ms=lag_ms,
            num_iterations=result.num_iterations if result else 0,
            num_points=result.num_points if result else 0,
            num_inliers=result.num_inliers if result else 0,
            fitness=result.fitness_m2 if result else None,
            degenerate_axes=degenerate_axes(result.hessian) if result else (),
            num_map_points=0 if self._map is None else len(self._map),
            num_scans_missed=self._scans.num_missed,
        )

    def _due_cloud(self) -> list[PointCloud]:
        period = self._stamp_ns // self._cloud_period_ns
        is_due = self._map is not None and period != self._cloud_period
        if is_due:
            self._cloud_period = period
        return [self.map_cloud()] if is_due else []
