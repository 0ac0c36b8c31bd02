"""Where offline mapping takes its scans from: a folder of clouds, or a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from services.recorder.bag.recording import Recording
from shared.cloud_files import read_cloud, scan_files, unit_warning
from shared.errors import CloudFileError, InputFileError
from shared.messaging.channels import (
    DEPTH_CAMERA_INFO,
    DEPTH_IMAGE,
    DEPTH_IMU,
    JOINTS_STATE,
    LEG_STATE,
    LIDAR_IMU,
    LIDAR_POINTS,
    ROBOT_DESCRIPTION,
    Channel,
)
from shared.messaging.messages import MAX_STAMP_NS, LidarScan, MapStatus, Measurement, Message
from shared.messaging.scans import scan_of

_MIN_POINTS = 3
_AFTER_NS = 500_000_000
"""So long after the last scan readings are looked at: it takes a revolution, and an IMU is late."""
Warn = Callable[[str], None]


class ScanSource(Protocol):
    """num_scans: how many scans it holds. messages: all that a mapper takes, in the order of time; may be read again.

    A scan that cannot be used is left out, and its problem told by `warn`, which names the file.
    """

    num_scans: int

    def messages(self, warn: Warn) -> Iterator[Message]:
        """The scans, and what was measured beside them."""

    def stamp_ns(self, status: MapStatus) -> int:
        """What stands for a scan in the trajectory."""


def scan_source(path: Path, num_scans: int | None, sensor: str, period_s: float | None = None) -> ScanSource:
    """A folder of data0.pcd, data1.pcd, ..., or a recording. num_scans: the first so many. sensor: lidar or depth.

    period_s: between the scans of a folder, see `FolderScans`.

    Raises:
        InputFileError: it is neither, or has no scans.
    """
    if path.is_dir():
        return FolderScans(path, num_scans, period_s)
    if path.suffix == ".mcap":
        return RecordedScans(path, num_scans, sensor)
    raise InputFileError(f"{path}: must be a folder with data0.pcd, data1.pcd, ..., or a recording, RUN.mcap")


class FolderScans:
    """Each cloud is a scan whose stamp is its number in seconds; its points are in the sensor's frame, in metres.

    period_s: what truly lies between two scans, so that they can be deskewed by their points' times; None: all points
    of a scan were measured at once.

    Raises:
        InputFileError: the folder has no such files.
    """

    def __init__(self, folder: Path, num_scans: int | None, period_s: float | None = None) -> None:
        self._folder = folder
        self._files = scan_files(folder).first(num_scans)
        self._period_ns = None if period_s is None else round(period_s * 1e9)
        self.num_scans = len(self._files.paths)

    def messages(self, warn: Warn) -> Iterator[LidarScan]:
        """One scan a file that can be read."""
        for name in self._files.missing:
            warn(f"{self._folder / name}: missing, the scans after it are mapped without it")
        for number, path in self._files.paths.items():
            scan = self._scan(number, path, warn)
            if scan is not None:
                yield scan

    def stamp_ns(self, status: MapStatus) -> int:
        """What stands for a scan in the trajectory: its number in seconds."""
        return status.scan_seq * 10**9

    def _scan(self, number: int, path: Path, warn: Warn) -> LidarScan | None:
        try:
            cloud = read_cloud(path)
        except (CloudFileError, InputFileError) as error:
            warn(f"{error}; left out")
            return None
        num_points = int(np.all(np.isfinite(cloud.points_m), axis=1).sum())
        problem = unit_warning(cloud.points_m)
        if num_points < _MIN_POINTS:
            problem = f"has {num_points} points, and {len(cloud.points_m) - num_points} that are not numbers"
        if problem is not None:
            warn(f"{path}: {problem}")
        stamp_ns = number * (self._period_ns or 10**9)
        t_ns = None if self._period_ns is None else cloud.t_ns
        return scan_of(cloud.points_m, stamp_ns, number, t_ns=t_ns)


_WITH_ALL = (ROBOT_DESCRIPTION, JOINTS_STATE, LEG_STATE)
_OF_SENSOR: dict[str, tuple[Channel, ...]] = {
    "lidar": (LIDAR_POINTS, LIDAR_IMU),
    "depth": (DEPTH_IMAGE, DEPTH_CAMERA_INFO, DEPTH_IMU),
}


class RecordedScans:
    """The scans, or depth images, of a recording, with joints, legs and the sensor's IMU.

    Raises:
        InputFileError: it is no whole recording, or has no scans of this sensor.
    """

    def __init__(self, path: Path, num_scans: int | None, sensor: str) -> None:
        self._recording = Recording(path)
        self._channels = (*_WITH_ALL, *_OF_SENSOR[sensor])
        scans = _OF_SENSOR[sensor][0]
        counts = {topic.topic: topic.num_messages for topic in self._recording.topics()}
        num_recorded = counts.get(scans.topic, 0)
        if num_recorded == 0:
            raise InputFileError(f"{path}: holds no messages of {scans.topic}")
        self._scan_type = scans.message
        self.num_scans = num_recorded if num_scans is None else min(num_scans, num_recorded)

    def messages(self, warn: Warn) -> Iterator[Message]:
        """As they were recorded, up to the last scan that is wanted and the readings that belong to it."""
        left, end_ns = self.num_scans, MAX_STAMP_NS
        for message in self._recording.messages(*self._channels):
            is_scan = type(message) is self._scan_type
            stamp_ns = message.stamp_ns if isinstance(message, Measurement) else 0
            if stamp_ns > end_ns:
                return
            if is_scan and left == 0:
                continue
            yield message
            left -= is_scan
            if left == 0:
                end_ns = min(end_ns, stamp_ns + _AFTER_NS)

    def stamp_ns(self, status: MapStatus) -> int:
        """When it was taken."""
        return status.stamp_ns
