"""Scores the mapper while it runs. The only place, but for reports, that sees both estimate and truth."""

from __future__ import annotations

from collections import OrderedDict
from typing import TypeVar

from services.evaluator.live_map import LiveMap
from services.evaluator.state import EvaluatorState
from services.evaluator.trajectory_error import TrajectoryComparison
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import (
    Event,
    Message,
    Odometry,
    PointCloud,
    Severity,
    StructureDescription,
    TrackingMetrics,
    Transforms,
)
from shared.runtime.config import EvaluatorConfig

M = TypeVar("M")

_MAX_WAITING = 1000


class Evaluator:
    """The facade: gets true transforms and odometry, pairs them by stamp, returns metrics at `config.rate_hz`.

    With the first pair it also returns the static transform world -> map, so that the estimate can be drawn in the
    world; the mapper itself never learns it. Where stamps go back, or the odometry is counted anew, simulation or
    mapper were started again: a new comparison begins. true_frame: that of the scans. seed: of the draw of map points.
    """

    def __init__(self, config: EvaluatorConfig, true_frame: str = "lidar", seed: int = 0) -> None:
        self._true_frame = true_frame
        self._period_ns = int(1e9 / config.rate_hz)
        self._map = LiveMap(seed)
        self._num_metrics = 0
        self._num_links = 0
        self._frames = "", ""
        self._begin()

    def _begin(self) -> None:
        self._comparison = TrajectoryComparison()
        self._true: OrderedDict[int, Transforms] = OrderedDict()
        self._estimated: OrderedDict[int, Odometry] = OrderedDict()
        self._last_true_ns = -1
        self._last_odometry = (-1, -1)
        self._due_ns = 0

    def set_structure(self, description: StructureDescription) -> list[Message]:
        """Takes what the map is compared with.

        Raises:
            InputFileError: the URDF is malformed, or has more than one link.
        """
        self._map.set_structure(description)
        return []

    def snapshot(self) -> EvaluatorState | None:
        """What `restore` needs; None before the first pair."""
        if (comparison := self._comparison.snapshot()) is None:
            return None
        last_odometry_ns, last_odometry_seq = self._last_odometry
        return EvaluatorState(
            comparison=comparison,
            world_frame=self._frames[0],
            map_frame=self._frames[1],
            last_true_ns=self._last_true_ns,
            last_odometry_ns=last_odometry_ns,
            last_odometry_seq=last_odometry_seq,
            due_ns=self._due_ns,
            num_metrics=self._num_metrics,
            num_links=self._num_links,
        )

    def restore(self, state: EvaluatorState) -> list[Message]:
        """Goes on scoring the same run; the link of world and map is told again, for those who come late.

        Raises:
            ValueError: a matrix in it is no pose.
        """
        self._comparison.restore(state.comparison)
        self._frames = state.world_frame, state.map_frame
        self._last_true_ns = state.last_true_ns
        self._last_odometry = state.last_odometry_ns, state.last_odometry_seq
        self._due_ns, self._num_metrics, self._num_links = state.due_ns, state.num_metrics, state.num_links
        stamp_ns, num_poses = max(state.last_true_ns, 0), self._comparison.result().num_poses
        text = f"restored at {stamp_ns / 1e9:.2f} s: goes on with the errors of {num_poses} poses"
        event = Event(stamp_ns=stamp_ns, seq=0, frame="", source="evaluator", severity=Severity.WARNING, text=text)
        return [self._world_to_map(stamp_ns), event]

    def add_cloud(self, cloud: PointCloud) -> list[Message]:
        """Takes the newest map; the next metrics tell its accuracy."""
        self._map.set_cloud(cloud)
        return []

    def add_transforms(self, transforms: Transforms) -> list[Message]:
        """Notes the true transforms at this stamp."""
        if transforms.stamp_ns < self._last_true_ns:
            self._begin()
        self._last_true_ns = transforms.stamp_ns
        _remember(self._true, transforms.stamp_ns, transforms)
        return self._pair(transforms.stamp_ns)

    def add_odometry(self, odometry: Odometry) -> list[Message]:
        """Notes the estimated pose at this stamp."""
        stamp_ns, seq = self._last_odometry
        if odometry.stamp_ns < stamp_ns or odometry.seq < seq:
            self._restart_estimate(is_new_mapper=odometry.seq < seq)
        self._last_odometry = odometry.stamp_ns, odometry.seq
        _remember(self._estimated, odometry.stamp_ns, odometry)
        return self._pair(odometry.stamp_ns)

    def _restart_estimate(self, *, is_new_mapper: bool) -> None:
        """What is known of the truth stays: the poses that belong together may have come already."""
        if is_new_mapper:
            self._map.forget()
        true, last_true_ns = self._true, self._last_true_ns
        self._begin()
        self._true, self._last_true_ns = true, last_true_ns

    def _pair(self, stamp_ns: int) -> list[Message]:
        if stamp_ns not in self._true or stamp_ns not in self._estimated:
            return []
        transforms, odometry = self._true.pop(stamp_ns), self._estimated.pop(stamp_ns)
        is_first = self._comparison.T_world_map is None
        T_map_lidar = SE3.from_xyz_quat_xyzw(odometry.T_frame_child)
        error = self._comparison.add(T_map_lidar, FrameTree(transforms).T_root(self._true_frame))
        messages: list[Message] = []
        if is_first:
            self._frames = transforms.frame, odometry.frame
            messages.append(self._world_to_map(stamp_ns))
        if is_first or stamp_ns >= self._due_ns:
            self._due_ns = stamp_ns + self._period_ns
            messages.append(self._metrics(stamp_ns, odometry.frame, error))
        return messages

    def _world_to_map(self, stamp_ns: int) -> Transforms:
        T_world_map, (world, map_frame) = self._comparison.T_world_map, self._frames
        assert T_world_map is not None
        self._num_links += 1
        return Transforms(
            stamp_ns=stamp_ns,
            seq=self._num_links - 1,
            frame=world,
            parents=(world,),
            children=(map_frame,),
            T_parent_child=T_world_map.xyz_quat_xyzw[None, :],
        )

    def _metrics(self, stamp_ns: int, map_frame: str, error: SE3) -> TrackingMetrics:
        result = self._comparison.result()
        assert self._comparison.T_world_map is not None
        accuracy = self._map.accuracy(self._comparison.T_world_map)
        self._num_metrics += 1
        return TrackingMetrics(
            stamp_ns=stamp_ns,
            seq=self._num_metrics - 1,
            frame=map_frame,
            num_poses=result.num_poses,
            ate_rmse_m=result.ate_rmse_m,
            rpe_rmse_m=result.rpe_rmse_m,
            last_error_m=float((error.translation @ error.translation) ** 0.5),
            last_error_rad=error.angle_rad,
            rpe_rmse_rad=result.rpe_rmse_rad,
            drift_m=result.drift_m,
            map_accuracy_mean_m=None if accuracy is None else accuracy.mean_m,
            map_accuracy_p95_m=None if accuracy is None else accuracy.p95_m,
            num_map_points=self._map.num_points,
        )


def _remember(waiting: OrderedDict[int, M], stamp_ns: int, message: M) -> None:
    waiting[stamp_ns] = message
    while len(waiting) > _MAX_WAITING:
        waiting.popitem(last=False)
