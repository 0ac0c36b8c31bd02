"""The viewer's facade: messages in, drawings out; the same for a live robot, a recording and `hyrecro map`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from services.viewer import colours
from services.viewer.drawing import Drawing, Drawn, Edges, Model
from services.viewer.trail import Trail
from shared.errors import MessageError
from shared.geometry import SE3
from shared.messaging import channels as c, messages as m
from shared.messaging.channels import Channel
from shared.messaging.frames import FrameTree

ROBOT, STRUCTURE, FIXED_FOOT = "robot", "structure", "fixed_foot"
TRUE_TRAIL, ESTIMATED_TRAIL = "trajectory/true", "trajectory/estimated"
FIXED_FOOT_STATE = f"{c.LEG_STATE.key}/fixed_foot"

MAX_RATES_HZ = {c.TF: 20.0, c.JOINTS_STATE: 20.0, c.DEPTH_IMAGE: 5.0, c.DEPTH_CAMERA_INFO: 1.0}
"""Of simulated time: as often as people look. The other channels are drawn message by message."""

_DEPTH_COLUMNS = 480
"""Depth images are thinned to at most so many columns, or they would be most of what the viewer holds."""
_DEPTH_RANGE_MM = (0.0, 6000.0)
_MM_PER_M = 1000.0
_SCAN_RADIUS = 1.8
_MAP_RADIUS_M = 0.005
_TRUE_RADIUS, _ESTIMATED_RADIUS = 3.5, 1.4
_OUTLINE_RADIUS = 0.9
"""Radii without unit are in points of the screen: they look alike from near and far."""
_STEP_M, _DASH_M = 0.005, 0.02
_CAMERA_SIZE_M = 0.12
_ESTIMATED_SUFFIX = "_estimated"
_MAX_FRAMES = 10_000
"""Far more than there are: whoever invents further ones is not remembered."""

_LOG_LEVELS = {
    m.Severity.INFO: rr.TextLogLevel.INFO,
    m.Severity.WARNING: rr.TextLogLevel.WARN,
    m.Severity.ERROR: rr.TextLogLevel.ERROR,
}


class Scene:
    """What one run looks like. An entity is called as its channel is; curves stand below it, a name each."""

    def __init__(self) -> None:
        self._drawn_ns: dict[Channel, int] = {}
        self._true_trail, self._estimated_trail = Trail(_DASH_M, is_dashed=True), Trail(_STEP_M)
        self._sensor_frame: str | None = None
        self._true_frames: set[str] = set()
        self._said: dict[str, object] = {}

    def is_due(self, channel: Channel, stamp_ns: int) -> bool:
        """Whether a message of this time would be drawn: more often than people look is not. Reckons it as drawn."""
        rate_hz = MAX_RATES_HZ.get(channel)
        last_ns = self._drawn_ns.get(channel)
        if rate_hz is not None and last_ns is not None and 0 <= stamp_ns - last_ns < 1e9 / rate_hz:
            return False
        self._drawn_ns[channel] = stamp_ns
        return True

    def draw(self, channel: Channel, message: m.Message) -> Iterable[Drawn]:
        """What this message changes; nothing for channels that have no picture."""
        draw = _DRAW.get(type(message))
        return () if draw is None else draw(self, channel.key, message)

    # ---- models and frames

    def _robot(self, _entity: str, description: m.RobotDescription) -> Iterable[Drawn]:
        yield Model(ROBOT, description.urdf)

    def _fixed_foot(self, _entity: str, description: m.FixedFootDescription) -> Iterable[Drawn]:
        yield Model(FIXED_FOOT, description.urdf)

    def _structure(self, _entity: str, description: m.StructureDescription) -> Iterable[Drawn]:
        yield Model(STRUCTURE, description.urdf)

    def _transforms(self, entity: str, transforms: m.Transforms) -> Iterable[Drawn]:
        stamp_ns = None if entity == c.TF_STATIC.key else transforms.stamp_ns
        yield Edges(entity, transforms.parents, transforms.children, transforms.T_parent_child, stamp_ns)
        if len(self._true_frames) < _MAX_FRAMES:
            self._true_frames.update(transforms.children)
        if self._sensor_frame is not None:
            try:
                position_m = FrameTree(transforms).T_root(self._sensor_frame).translation
            except MessageError:  # not all trees have the sensor in them
                return
            yield from _trail(TRUE_TRAIL, self._true_trail, position_m, transforms.frame, transforms.stamp_ns)

    def _odometry(self, entity: str, odometry: m.Odometry) -> Iterable[Drawn]:
        """A real sensor, whose true place nobody knows, is drawn where it is believed to be."""
        self._sensor_frame = odometry.child_frame.removesuffix(_ESTIMATED_SUFFIX)
        parents, children = [odometry.frame], [odometry.child_frame]
        poses = [odometry.T_frame_child]
        if self._sensor_frame not in self._true_frames:
            parents, children = [*parents, odometry.child_frame], [*children, self._sensor_frame]
            poses.append(SE3.identity().xyz_quat_xyzw)
        yield Edges(entity, tuple(parents), tuple(children), np.array(poses), odometry.stamp_ns)
        position_m = SE3.from_xyz_quat_xyzw(odometry.T_frame_child).translation
        yield from _trail(ESTIMATED_TRAIL, self._estimated_trail, position_m, odometry.frame, odometry.stamp_ns)

    # ---- sensors and map

    def _scan(self, entity: str, scan: m.LidarScan) -> Iterable[Drawn]:
        yield scan_drawing(entity, scan.points_m, scan.frame, scan.stamp_ns)

    def _cloud(self, entity: str, cloud: m.PointCloud) -> Iterable[Drawn]:
        points = rr.Points3D(cloud.points_m, colors=colours.MAP, radii=_MAP_RADIUS_M)
        yield Drawing(entity, points, cloud.stamp_ns, cloud.frame)

    def _planes(self, entity: str, plane_map: m.PlaneMap) -> Iterable[Drawn]:
        outlines = [np.vstack([plane.outline_m, plane.outline_m[:1]]) for plane in plane_map.planes]
        lines = rr.LineStrips3D(
            outlines, colors=[plane.colour for plane in plane_map.planes], radii=rr.Radius.ui_points(_OUTLINE_RADIUS)
        )
        yield Drawing(entity, lines, plane_map.stamp_ns, plane_map.frame)

    def _depth_image(self, entity: str, image: m.DepthImage) -> Iterable[Drawn]:
        stride = _depth_stride(image.width)
        thinned_mm = image.depth_mm.reshape(image.height, image.width)[::stride, ::stride]
        depth = rr.DepthImage(
            np.ascontiguousarray(thinned_mm), meter=_MM_PER_M, colormap="turbo", depth_range=_DEPTH_RANGE_MM
        )
        yield Drawing(entity, depth, image.stamp_ns, _image_plane(image.frame))

    def _camera(self, entity: str, camera: m.CameraInfo) -> Iterable[Drawn]:
        stride = _depth_stride(camera.width)
        pinhole = rr.Pinhole(
            resolution=(-(-camera.width // stride), -(-camera.height // stride)),
            focal_length=(camera.fx / stride, camera.fy / stride),
            principal_point=(camera.cx / stride, camera.cy / stride),
            camera_xyz=rr.ViewCoordinates.RDF,
            parent_frame=camera.frame,
            child_frame=_image_plane(camera.frame),
            image_plane_distance=_CAMERA_SIZE_M,
        )
        yield Drawing(entity, pinhole, camera.stamp_ns, camera.frame)

    # ---- curves and words

    def _joints(self, entity: str, joints: m.JointState) -> Iterable[Drawn]:
        yield Drawing(entity, rr.Scalars(joints.q), joints.stamp_ns)

    def _legs(self, entity: str, legs: m.LegState) -> Iterable[Drawn]:
        yield from _curves(entity, legs.stamp_ns, {"margin": legs.margin})
        if self._is_news(entity, legs.fixed_foot):
            yield Drawing(FIXED_FOOT_STATE, rr.StateChange(state=legs.fixed_foot.value), legs.stamp_ns)

    def _status(self, entity: str, status: m.MapStatus) -> Iterable[Drawn]:
        slip_m = status.leg_slip_m
        values = {
            "registration_ms": status.registration_ms,
            "lag_ms": status.lag_ms,
            "score": status.score,
            "lost_scans": status.num_lost_scans,
            "slip_mm": None if slip_m is None else slip_m * _MM_PER_M,
        }
        return _curves(entity, status.stamp_ns, values)

    def _metrics(self, entity: str, metrics: m.TrackingMetrics) -> Iterable[Drawn]:
        values = {"ate_mm": metrics.ate_rmse_m * _MM_PER_M, "last_error_mm": metrics.last_error_m * _MM_PER_M}
        return _curves(entity, metrics.stamp_ns, values)

    def _foot_status(self, entity: str, status: m.FootStatus) -> Iterable[Drawn]:
        if self._is_news(entity, (status.foot, status.phase)):
            text = f"[planner] foot {status.foot.value}: {status.phase.value} {status.text}".rstrip()
            yield _line(entity, text, m.Severity.INFO, status.stamp_ns)

    def _event(self, entity: str, event: m.Event) -> Iterable[Drawn]:
        yield _line(entity, f"[{event.source}] {event.text}", event.severity, event.stamp_ns)

    def _recorder(self, entity: str, status: m.RecorderStatus) -> Iterable[Drawn]:
        counts = {record.key: record.num_lost_on_bus + record.num_lost_to_disk for record in status.channels}
        lost = {key: num for key, num in counts.items() if num}
        if lost and self._is_news(entity, lost):
            text = "[recorder] lost so far: " + ", ".join(f"{num} of {key}" for key, num in lost.items())
            yield _line(entity, text, m.Severity.WARNING, status.stamp_ns)

    def _is_news(self, entity: str, said: object) -> bool:
        is_news = self._said.get(entity) != said
        self._said[entity] = said
        return is_news


def scan_drawing(entity: str, points_m: NDArray[np.floating], frame: str, stamp_ns: int) -> Drawing:
    """The points (N, 3) of a scan in their sensor's frame, coloured by their range."""
    radius = rr.Radius.ui_points(_SCAN_RADIUS)
    points = rr.Points3D(points_m, colors=colours.range_colours(points_m), radii=radius)
    return Drawing(entity, points, stamp_ns, frame)


def _trail(entity: str, trail: Trail, position_m: Any, frame: str, stamp_ns: int) -> Iterable[Drawn]:
    line = trail.step(position_m)
    if line is None:
        return
    is_true = entity == TRUE_TRAIL
    strip = rr.LineStrips3D(
        [line],
        colors=colours.TRUE_TRAIL if is_true else colours.ESTIMATED_TRAIL,
        radii=rr.Radius.ui_points(_TRUE_RADIUS if is_true else _ESTIMATED_RADIUS),
    )
    yield Drawing(entity, strip, stamp_ns, frame)


def _curves(entity: str, stamp_ns: int, values: Mapping[str, float | None]) -> Iterable[Drawn]:
    for name, value in values.items():
        if value is not None:
            yield Drawing(f"{entity}/{name}", rr.Scalars(value), stamp_ns)


def _line(entity: str, text: str, severity: m.Severity, stamp_ns: int) -> Drawing:
    return Drawing(entity, rr.TextLog(text, level=_LOG_LEVELS[severity]), stamp_ns)


def _depth_stride(width: int) -> int:
    return -(-width // _DEPTH_COLUMNS)


def _image_plane(frame: str) -> str:
    return f"{frame}_image"


_DRAW: dict[type[m.Message], Callable[[Scene, str, Any], Iterable[Drawn]]] = {
    m.RobotDescription: Scene._robot,
    m.FixedFootDescription: Scene._fixed_foot,
    m.StructureDescription: Scene._structure,
    m.Transforms: Scene._transforms,
    m.Odometry: Scene._odometry,
    m.LidarScan: Scene._scan,
    m.PointCloud: Scene._cloud,
    m.PlaneMap: Scene._planes,
    m.DepthImage: Scene._depth_image,
    m.CameraInfo: Scene._camera,
    m.JointState: Scene._joints,
    m.LegState: Scene._legs,
    m.MapStatus: Scene._status,
    m.TrackingMetrics: Scene._metrics,
    m.FootStatus: Scene._foot_status,
    m.Event: Scene._event,
    m.RecorderStatus: Scene._recorder,
}


def has_picture(channel: Channel) -> bool:
    """Whether messages of this channel are drawn at all. The depth camera's cloud is not: its image says the same."""
    return channel.message in _DRAW and channel.is_recorded
