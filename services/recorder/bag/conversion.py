"""A recording as a rosbag2 folder, or its clouds as files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError

from services.recorder.bag.overview import Progress
from services.recorder.bag.recorded import RecordingReader, UnreadableError
from services.recorder.ros import schemas as ros
from shared.cloud_files import write_cloud, write_scan
from shared.depth_points import points_of
from shared.errors import InputFileError
from shared.messaging.channels import Channel, channel_of_key, sensor_channels
from shared.messaging.messages import CameraInfo, DepthImage, LidarScan, PointCloud

CloudFormat = Literal["pcd", "ply", "las"]
_ROSBAG2_VERSION: Literal[9] = 9


@dataclass(frozen=True, slots=True)
class Converted:
    """num_written: messages of a rosbag2 folder, or files. problems: what could not be read, a line each."""

    num_written: int
    problems: tuple[str, ...]


def to_rosbag2(path: Path, out: Path, on_progress: Progress = lambda _: None) -> Converted:
    """Writes a new rosbag2 folder (MCAP inside): all known channels, at the times they were recorded with.

    Raises:
        InputFileError: the recording cannot be read, or `out` exists or cannot be written.
    """
    reader = RecordingReader(path)
    connections: dict[str, Connection] = {}
    num_written = 0
    try:
        with Writer(out, version=_ROSBAG2_VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
            for recorded in reader.messages():
                topic, ros_type = recorded.channel.topic, recorded.channel.ros_type
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, ros_type, typestore=ros.typestore())
                writer.write(connections[topic], recorded.log_ns, recorded.data)
                num_written += 1
                on_progress(reader.num_read_bytes / reader.blocks.num_bytes)
    except WriterError as error:
        raise InputFileError(str(error)) from error
    except OSError as error:
        raise InputFileError(f"{out}: cannot be written: {error.strerror}") from error
    return Converted(num_written, _problems(reader))


def to_clouds(
    path: Path, out: Path, channel: Channel, suffix: CloudFormat, on_progress: Progress = lambda _: None
) -> Converted:
    """Writes data0, data1 ... into a new or empty folder, a file a message; of a map, which grows, only the last.

    PCD files of scans have intensity, time and ring. `depth/points` is made of the depth images.

    Raises:
        InputFileError: the recording cannot be read, holds no such clouds, or `out` is not empty or not writable.
    """
    sources = _sources_of(channel)
    camera = _first_camera(path, sources)
    _make_empty(out)
    reader = RecordingReader(path, sources.__contains__)
    clouds = _Clouds(reader, camera, on_progress)
    is_map = channel.key.startswith("map/")
    last: PointCloud | None = None
    num_written = 0
    for cloud in clouds.all():
        if is_map:
            last = cloud if isinstance(cloud, PointCloud) else last
            continue
        _write(out / f"data{num_written}.{suffix}", cloud)
        num_written += 1
    if last is not None:
        _write(out / f"data0.{suffix}", last)
        num_written = 1
    if not num_written:
        raise InputFileError(f"{path}: holds no clouds of {channel.key}")
    return Converted(num_written, (*clouds.problems, *_problems(reader)))


def cloud_channel(key: str) -> Channel:
    """The channel of this key, if it carries clouds.

    Raises:
        InputFileError: it does not.
    """
    channel = channel_of_key(f"hyrecro/{key}")
    if channel is None or channel.message not in (LidarScan, PointCloud):
        raise InputFileError(f"--channel {key}: carries no clouds; lidar/points, depth/points and map/cloud do")
    return channel


class _Clouds:
    """The clouds of a recording, one after the other."""

    def __init__(self, reader: RecordingReader, camera: CameraInfo | None, on_progress: Progress) -> None:
        self._reader, self._camera, self._on_progress = reader, camera, on_progress
        self.problems: list[str] = []

    def all(self) -> Iterator[LidarScan | PointCloud]:
        for recorded in self._reader.messages():
            self._on_progress(self._reader.num_read_bytes / self._reader.blocks.num_bytes)
            try:
                message = recorded.message()
            except UnreadableError as error:
                self.problems.append(str(error))
                continue
            if isinstance(message, CameraInfo):
                self._camera = message
            elif isinstance(message, DepthImage) and self._camera is not None:
                yield _points(message, self._camera)
            elif isinstance(message, LidarScan | PointCloud):
                yield message


def _first_camera(path: Path, sources: tuple[Channel, ...]) -> CameraInfo | None:
    """The first image may come before its camera's intrinsics."""
    infos = [channel for channel in sources if channel.message is CameraInfo]
    if not infos:
        return None
    recorded = next(RecordingReader(path, infos.__contains__).messages(), None)
    if recorded is None:
        raise InputFileError(f"{path}: holds no {infos[0].key}, without which depth images are no points")
    message = recorded.message()
    assert isinstance(message, CameraInfo)
    return message


def _points(image: DepthImage, camera: CameraInfo) -> PointCloud:
    depth_mm = image.depth_mm.reshape(image.height, image.width)
    points_m = points_of(depth_mm, camera.fx, camera.fy, camera.cx, camera.cy, 1)
    return PointCloud(stamp_ns=image.stamp_ns, seq=image.seq, frame=image.frame, points_m=points_m)


def _sources_of(channel: Channel) -> tuple[Channel, ...]:
    """What its clouds are made of: itself, or images and their camera."""
    if channel.is_recorded:
        return (channel,)
    return tuple(of for of in sensor_channels(channel.key.partition("/")[0]) if of.message in (DepthImage, CameraInfo))


def _write(path: Path, cloud: LidarScan | PointCloud) -> None:
    if isinstance(cloud, LidarScan) and path.suffix == ".pcd":
        write_scan(path, cloud)
    else:
        write_cloud(path, cloud.points_m)


def _make_empty(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
        is_empty = not any(out.iterdir())
    except OSError as error:
        raise InputFileError(f"{out}: {error.strerror}") from error
    if not is_empty:
        raise InputFileError(f"{out}: is not empty; nothing is overwritten")


def _problems(reader: RecordingReader) -> tuple[str, ...]:
    damage = [str(damage) for damage in reader.damage if damage.has_data]
    unknown = [f"{topic}: {num} messages of no channel known here" for topic, num in reader.unknown.items()]
    return (*damage, *unknown)
