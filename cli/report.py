"""Scores a recorded run: trajectory and map against the truth, messages by channel, time a scan."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cli.mapping import map_scans
from cli.scan_sources import scan_source
from services.evaluator.map_accuracy import map_accuracy, num_points_off_planes
from services.evaluator.trajectory_error import compare_trajectories
from services.mapper.filters import ScanFilter
from services.mapper.motion_model import TREND
from services.mapper.voxel_map import VoxelMap
from services.recorder.bag.recording import Recording
from shared.errors import HyrecroError
from shared.geometry import SE3
from shared.messaging.channels import (
    HEALTH,
    LIDAR_POINTS,
    MAP_CLOUD,
    MAP_ODOMETRY,
    MAP_STATUS,
    STRUCTURE_DESCRIPTION,
    TF,
    channels_of,
)
from shared.messaging.frames import FrameTree
from shared.messaging.messages import (
    Health,
    LidarScan,
    MapStatus,
    Odometry,
    PointCloud,
    StructureDescription,
    Transforms,
)
from shared.robot.urdf import parse_urdf
from shared.runtime.config import Config

StampedPoses = list[tuple[int, SE3]]


@dataclass(frozen=True, slots=True)
class RunReport:
    """figures: what report.json holds. estimated, true: stamped poses of the LiDAR in the world, pairwise.

    map_points_m: the map (N, 3) in the world frame.
    """

    figures: dict[str, Any]
    estimated: StampedPoses
    true: StampedPoses
    map_points_m: NDArray[np.floating]


def score_run(recording: Recording, config: Config) -> RunReport:
    """The report of a finished recording.

    Raises:
        HyrecroError: the recording holds no odometry, map or structure to score.
    """
    estimated, true = _paired_poses(recording, mapped_frame(config))
    cloud = _last_map(recording)
    T_world_map = true[0][1] @ estimated[0][1].inv()
    map_points_m = T_world_map.apply(cloud.points_m)
    error = compare_trajectories([pose for _, pose in estimated], [pose for _, pose in true])
    structure = next(iter(recording.messages(STRUCTURE_DESCRIPTION)), None)
    if structure is None:
        raise HyrecroError(f"{recording.path}: holds no structure to compare the map with")
    urdf = cast(StructureDescription, structure).urdf
    accuracy = map_accuracy(map_points_m, parse_urdf(urdf, STRUCTURE_DESCRIPTION.topic))

    def off_planes(points_m: NDArray[np.floating] | None) -> int | None:
        if points_m is None:
            return None
        settings = config.evaluator
        return num_points_off_planes(
            points_m, num_planes=settings.num_planes, distance_m=settings.plane_distance_m, seed=config.seed
        )

    channels = count_messages(recording, config.sensors.others)
    figures = {
        "ate_rmse_m": error.ate_rmse_m,
        "ate_max_m": error.ate_max_m,
        "rpe_rmse_m": error.rpe_rmse_m,
        "rpe_rmse_rad": error.rpe_rmse_rad,
        "num_poses": error.num_poses,
        "map_accuracy_mean_m": accuracy.mean_m,
        "map_accuracy_p95_m": accuracy.p95_m,
        "map_points": accuracy.num_points,
        "off_plane_points": off_planes(cloud.points_m),
        "off_plane_points_true_poses": off_planes(_map_with_true_poses(recording, true, config)),
        "prior": config.mapper.prior,
        "with_other_prior": _mapped_again(recording, true, config),
        **_timing(recording),
        "duration_s": recording.duration_s,
        "lost_messages": sum(int(counts["lost"] or 0) for counts in channels.values()),
        "channels": channels,
    }
    in_world = [(stamp, T_world_map @ pose) for stamp, pose in estimated]
    return RunReport(figures, in_world, true, map_points_m)


def count_messages(recording: Recording, other_sensors: Iterable[str] = ()) -> dict[str, dict[str, float | int | None]]:
    """By key: published (as the publishers' heartbeats count it), recorded, lost, and the mean rate recorded.

    published is None for a key whose publisher sends no heartbeat, such as a person's commands.
    """
    published: dict[str, int] = {}
    last_health = {health.service: health for health in cast(Iterator[Health], recording.messages(HEALTH))}
    for health in last_health.values():
        for count in health.channels:
            if count.num_sent:
                published[count.key] = published.get(count.key, 0) + count.num_sent
    counts: dict[str, dict[str, float | int | None]] = {}
    keys = {channel.topic: channel.key_expr for channel in channels_of(other_sensors)}
    for topic in recording.topics():
        key = keys.get(topic.topic) or HEALTH.of(topic.topic.rsplit("/", 1)[-1]).key_expr
        sent = published.get(key)
        lost = topic.num_missed if sent is None else max(sent - topic.num_messages, topic.num_missed, 0)
        rate = topic.num_messages / recording.duration_s if recording.duration_s > 0 else 0.0
        counts[key] = {"published": sent, "received": topic.num_messages, "lost": lost, "rate_hz": round(rate, 2)}
    return counts


def _paired_poses(recording: Recording, frame: str) -> tuple[StampedPoses, StampedPoses]:
    estimated = {
        odometry.stamp_ns: SE3.from_xyz_quat_xyzw(odometry.T_frame_child)
        for odometry in cast(Iterator[Odometry], recording.messages(MAP_ODOMETRY))
    }
    true: StampedPoses = []
    for transforms in cast(Iterator[Transforms], recording.messages(TF)):
        if transforms.stamp_ns in estimated:
            true.append((transforms.stamp_ns, FrameTree(transforms).T_root(frame)))
    if not true:
        raise HyrecroError(f"{recording.path}: holds no odometry with a true pose at the same time")
    return [(stamp_ns, estimated[stamp_ns]) for stamp_ns, _ in true], true


def _last_map(recording: Recording) -> PointCloud:
    clouds = deque(recording.messages(MAP_CLOUD), maxlen=1)
    if not clouds:
        raise HyrecroError(f"{recording.path}: holds no map")
    return cast(PointCloud, clouds[0])


def _map_with_true_poses(recording: Recording, true: StampedPoses, config: Config) -> NDArray[np.float64] | None:
    """The map that the mapper would have made, had it known every pose; None for depth images."""
    if config.mapper.input != "lidar":
        return None
    poses, first = dict(true), true[0][1].inv()
    scan_filter, voxels = ScanFilter(config.mapper), VoxelMap(config.mapper.voxel_size_m, config.mapper.max_map_points)
    for scan in cast(Iterator[LidarScan], recording.messages(LIDAR_POINTS)):
        if scan.stamp_ns in poses:
            points_m = scan_filter.filtered(scan.points_m).points_m
            voxels.insert((first @ poses[scan.stamp_ns]).apply(points_m))
    return voxels.points_m


def _mapped_again(recording: Recording, true: StampedPoses, config: Config) -> dict[str, Any]:
    """The same scans mapped once more, without leg odometry; or with it, where the run was without."""
    prior = TREND if config.mapper.prior == "legs" else "legs"
    settings = config.model_copy(update={"mapper": config.mapper.model_copy(update={"prior": prior})})
    run = map_scans(settings, scan_source(recording.path, None, config.mapper.input))
    poses = dict(true)
    pairs = [(pose, poses[stamp]) for stamp, pose in zip(run.stamps_ns, run.poses, strict=True) if stamp in poses]
    error = compare_trajectories([pose for pose, _ in pairs], [pose for _, pose in pairs])
    return {
        "prior": prior,
        "ate_rmse_m": error.ate_rmse_m,
        "rpe_rmse_m": error.rpe_rmse_m,
        "num_poses": error.num_poses,
        "num_scans_lost_tracking": run.is_tracked.count(False),
    }


def mapped_frame(config: Config) -> str:
    """The frame of the sensor that is mapped with."""
    sensors = config.sensors
    return sensors.lidar.frame if config.mapper.input == "lidar" else sensors.depth.frame


def _timing(recording: Recording) -> dict[str, float | int]:
    statuses = cast("list[MapStatus]", list(recording.messages(MAP_STATUS)))
    registration_ms = np.array([status.registration_ms for status in statuses] or [np.nan])
    return {
        "ms_per_scan_p50": float(np.percentile(registration_ms, 50)),
        "ms_per_scan_p95": float(np.percentile(registration_ms, 95)),
        "num_scans": len(statuses),
        "num_scans_lost_tracking": sum(not status.is_tracking for status in statuses),
        "num_scans_missed": sum(status.num_scans_missed for status in statuses[-1:]),
    }
