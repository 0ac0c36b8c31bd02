"""The map, and where scans are in it: begins with the first usable scan, or in a loaded map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.cloud_alignment import CloudAlignment
from services.mapper.matching import make_matcher
from services.mapper.priors.interface import Step
from services.mapper.registration import Points, RegistrationError, ScanMatcher
from services.mapper.state import MapState, TrackState
from services.mapper.tracking import Track, Tracker
from services.mapper.voxel_map import VoxelMap
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

_LOCALISER = "gicp"
"""The method that finds the first scan in a loaded map; the configured one goes on from there."""


class Target:
    """What scans are aligned to, and the cloud of all that were believed.

    loaded_map_m: points (N, 3) of a map in which the first scan is looked for, None to begin a new one.
    """

    def __init__(self, config: MapperConfig, loaded_map_m: NDArray[np.float64] | None = None) -> None:
        self._config = config
        self._loaded_map_m = loaded_map_m
        self._tracker: Tracker | None = None
        self._T_map_first = SE3.identity()
        self._is_restarted = False
        self.num_lost_scans = 0
        self.matcher: ScanMatcher
        self._begin_empty()

    @property
    def has_begun(self) -> bool:
        """Whether there is a map."""
        return self._tracker is not None

    @property
    def num_points(self) -> int:
        """Of the map's cloud."""
        return len(self._voxels)

    @property
    def points_m(self) -> NDArray[np.float64]:
        """The map's cloud (N, 3), a point a voxel, in the map frame."""
        return self._voxels.points_m

    def restart(self) -> None:
        """The next scan is where the map began, or else begins a new map."""
        if self._tracker is not None:
            self._tracker = Tracker(self._config, self.matcher, self._T_map_first, self._cloud)
            self._is_restarted = True

    def snapshot(self) -> TrackState | None:
        """Where the sensor is; None before there is a map."""
        if self._tracker is None:
            return None
        return TrackState(
            T_map_sensor=self._tracker.T_map_sensor.matrix,
            T_map_tracked=self._tracker.T_map_tracked.matrix,
            T_map_first=self._T_map_first.matrix,
            num_lost=self._tracker.num_lost,
            num_lost_scans=self.num_lost_scans,
        )

    def map_snapshot(self, stamp_ns: int) -> MapState | None:
        """The map as it is at that time; None before there is one."""
        if self._tracker is None:
            return None
        return MapState(stamp_ns=stamp_ns, target=self.matcher.snapshot(), cloud=self._voxels.snapshot())

    def restore(self, track: TrackState, known: MapState) -> None:
        """Goes on with a map, and from where the sensor was.

        Raises:
            ValueError, RegistrationError: they cannot be of these settings; nothing has changed.
        """
        matcher, voxels = make_matcher(self._config), VoxelMap(self._config.voxel_size_m, self._config.max_map_points)
        matcher.restore(known.target)
        voxels.restore(known.cloud)
        T_map_sensor, T_map_tracked = SE3.from_matrix(track.T_map_sensor), SE3.from_matrix(track.T_map_tracked)
        self._T_map_first = SE3.from_matrix(track.T_map_first)
        self._begin(matcher, voxels)
        self._tracker = Tracker(
            self._config, matcher, T_map_sensor, self._cloud, T_map_tracked=T_map_tracked, num_lost=track.num_lost
        )
        self.num_lost_scans = track.num_lost_scans

    def add_to_cloud(self, points_m: Points, track: Track) -> None:
        """Takes a scan (N, 3) that was followed into the map's cloud, if it is believed."""
        if track.is_tracking:
            self._voxels.insert(track.T_map_sensor.apply(points_m))

    def look(self, points_m: Points, step: Step) -> SE3 | None:
        """Where a filtered scan (N, 3) seems to be in the map, without taking it in; None where it is not clear."""
        if self._tracker is None or self._is_restarted:
            return None
        return self._tracker.look(points_m, step.T_last_now)

    def follow(self, points_m: Points, step: Step) -> Track:
        """Finds a filtered scan (N, 3), in the sensor's frame, and takes it into what further scans are aligned to."""
        track = self._followed(points_m, step)
        self.num_lost_scans += not track.is_tracking
        return track

    def _followed(self, points_m: Points, step: Step) -> Track:
        is_restarted, self._is_restarted = self._is_restarted, False
        if self._tracker is not None:
            T_last_now = SE3.identity() if is_restarted else step.T_last_now
            track = self._tracker.follow(points_m, T_last_now, is_measured=step.is_measured and not is_restarted)
            if track.is_tracking or not is_restarted:
                return track
            self._begin_empty()
        return self._first(points_m)

    def _first(self, points_m: Points) -> Track:
        try:
            T_map_sensor = SE3.identity() if self._loaded_map_m is None else self._in_loaded_map(points_m)
            self.matcher.start(points_m, T_map_sensor)
        except RegistrationError:
            return Track(SE3.identity(), False)
        self._T_map_first = T_map_sensor
        self._tracker = Tracker(self._config, self.matcher, T_map_sensor, self._cloud)
        return Track(T_map_sensor, True)

    def _in_loaded_map(self, points_m: Points) -> SE3:
        finder = make_matcher(self._config.model_copy(update={"method": _LOCALISER}))
        assert self._loaded_map_m is not None
        finder.start(self._loaded_map_m, SE3.identity())
        result = finder.localise(points_m)
        if result is None or result.is_suspect or result.score < self._config.min_score:
            raise RegistrationError("the scan was not found in the loaded map")
        return result.T_map_lidar

    def _begin_empty(self) -> None:
        self._tracker = None
        self._begin(make_matcher(self._config), VoxelMap(self._config.voxel_size_m, self._config.max_map_points))
        if self._loaded_map_m is not None:
            self._voxels.insert(self._loaded_map_m)

    def _begin(self, matcher: ScanMatcher, voxels: VoxelMap) -> None:
        self.matcher, self._voxels = matcher, voxels
        has_planes = self._config.method == "plane" and self._config.scan_to == "map"
        self._cloud = CloudAlignment(self._config, voxels) if has_planes else None
