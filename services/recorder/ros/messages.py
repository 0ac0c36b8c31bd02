"""Messages as ROS 2 CDR bytes: one function a message type, and the table that names the ROS type of each.

Headers carry the message's own stamp and frame. Commands have no stamp: theirs is the time at which they came.
"""

from __future__ import annotations

import dataclasses
import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.recorder.ros import schemas as ros, sensors
from shared.errors import MessageError
from shared.geometry import SE3
from shared.messaging import messages as m
from shared.messaging.codec import to_jsonable

UNKNOWN = float("nan")
NO_POSE = np.full(7, UNKNOWN)

# rcl_interfaces/msg/Log: level constants
LOG_LEVELS = {m.Severity.INFO: 20, m.Severity.WARNING: 30, m.Severity.ERROR: 40}

_DIAGNOSTIC_OK = 0
"""diagnostic_msgs/DiagnosticStatus.OK: a heartbeat reports numbers and leaves the verdict to the reader."""

_COUNTERS = ("num_sent", "num_bytes_sent", "num_received", "num_missed", "num_dropped", "num_refused", "num_waiting")
_KNOWN_OR_NOT = ("last_seq", "wait_median_s", "wait_max_s")


@dataclass(frozen=True, slots=True)
class RosForm:
    """How one message type is recorded: its ROS type, and a function (message, stamp_ns) -> ROS message."""

    ros_type: str
    build: Callable[[Any, int], object]


def to_cdr(message: m.Message, stamp_ns: int) -> tuple[str, memoryview]:
    """The ROS type name and the CDR bytes (little-endian, with encapsulation header) of a message.

    stamp_ns: simulated time put into the headers.

    Raises:
        MessageError: the message type has no ROS form, a number in it does not fit, or the stamp is no ROS time.
    """
    form = ROS_FORMS.get(type(message))
    if form is None:
        known = ", ".join(sorted(message_type.__name__ for message_type in ROS_FORMS))
        raise MessageError(f"{type(message).__name__} has no ROS form; these have one: {known}")
    if not 0 <= stamp_ns <= m.MAX_STAMP_NS:
        raise MessageError(f"{type(message).__name__}: stamp_ns is {stamp_ns}, must be within 0 .. {m.MAX_STAMP_NS}")
    try:
        data = ros.typestore().serialize_cdr(form.build(message, stamp_ns), form.ros_type, little_endian=True)
    except (struct.error, OverflowError, ValueError) as error:
        raise MessageError(f"{type(message).__name__}: {form.ros_type} cannot hold it: {error}") from error
    return form.ros_type, data


def _or_unknown(value: float | None) -> float:
    return UNKNOWN if value is None else value


# ---- the robot


def _joint_state(
    header: object,
    names: tuple[str, ...],
    position: NDArray[np.float64],
    velocity: NDArray[np.float64] | None = None,
    effort: NDArray[np.float64] | None = None,
) -> object:
    """sensor_msgs/JointState: an empty array says that the quantity is not given."""
    none = np.empty(0)
    return ros.new(
        "sensor_msgs/msg/JointState",
        header=header,
        name=list(names),
        position=position,
        velocity=none if velocity is None else velocity,
        effort=none if effort is None else effort,
    )


def _joint_target(target: m.JointTarget, stamp_ns: int) -> object:
    """How long it may take and is valid has no place in a JointState and is not recorded."""
    names = m.JOINT_NAMES[: len(target.q)] if target.names is None else target.names
    return _joint_state(ros.header(stamp_ns, ""), names, target.q)


def _actuator_target(target: m.ActuatorTarget, stamp_ns: int) -> object:
    names = m.ACTUATOR_NAMES[: len(target.positions)] if target.names is None else target.names
    return _joint_state(ros.header(stamp_ns, ""), names, target.positions)


def _actuators(state: m.ActuatorState, stamp_ns: int) -> object:
    header = ros.header(stamp_ns, state.frame)
    return _joint_state(header, m.ACTUATOR_NAMES, state.positions, state.velocities)


def _foot_target(target: m.FootTarget, stamp_ns: int) -> object:
    """Which foot is meant has no place in a PoseStamped. A point and a normal become a pose with z along the normal."""
    if target.T_world_foot is not None:
        pose = target.T_world_foot
    else:
        assert target.point_m is not None
        assert target.normal is not None
        pose = SE3.from_z_axis(target.normal, target.point_m).xyz_quat_xyzw
    return ros.new("geometry_msgs/msg/PoseStamped", header=ros.header(stamp_ns, "world"), pose=ros.pose(pose))


def _stop(stop: m.Stop, _stamp_ns: int) -> object:
    return ros.string(stop.text)


def _control(control: m.SimControl | m.RecorderControl | m.ReplayControl, _stamp_ns: int) -> object:
    """The JSON that could have been typed."""
    return ros.string(json.dumps({key: value for key, value in to_jsonable(control).items() if value is not None}))


def _joints(state: m.JointState, stamp_ns: int) -> object:
    return _joint_state(ros.header(stamp_ns, state.frame), m.JOINT_NAMES, state.q, state.dq, state.effort)


def _leg_target(target: m.LegTarget, _stamp_ns: int) -> object:
    return ros.string(target.foot.value)


def _leg_state(state: m.LegState, stamp_ns: int) -> object:
    return ros.own(
        state,
        stamp_ns,
        fixed_foot=state.fixed_foot.value,
        foot_pose=ros.pose(state.T_world_foot),
        is_contact_known=state.has_contact is not None,
        has_contact=bool(state.has_contact),
        is_holding_known=state.holding is not None,
        holding=[foot.value for foot in state.holding or ()],
        wrench=ros.wrench(np.full(6, UNKNOWN) if state.wrench is None else state.wrench),
        load_n=_or_unknown(state.load_n),
        margin=_or_unknown(state.margin),
    )


def _foot_status(status: m.FootStatus, stamp_ns: int) -> object:
    return ros.own(
        status,
        stamp_ns,
        foot=status.foot.value,
        phase=status.phase.value,
        is_goal_known=status.T_world_goal is not None,
        goal=ros.pose(NO_POSE if status.T_world_goal is None else status.T_world_goal),
        duration_s=_or_unknown(status.duration_s),
        margin=_or_unknown(status.margin),
    )


def _transform(stamp_ns: int, parent: str, child: str, xyz_quat_xyzw: list[float]) -> object:
    return ros.new(
        "geometry_msgs/msg/TransformStamped",
        header=ros.header(stamp_ns, parent),
        child_frame_id=child,
        transform=ros.new(
            "geometry_msgs/msg/Transform",
            translation=ros.vector(xyz_quat_xyzw[:3]),
            rotation=ros.quaternion(xyz_quat_xyzw[3:]),
        ),
    )


def _transforms(edges: m.Transforms, stamp_ns: int) -> object:
    rows = zip(edges.parents, edges.children, edges.T_parent_child.tolist(), strict=True)
    transforms = [_transform(stamp_ns, parent, child, row) for parent, child, row in rows]
    return ros.new("tf2_msgs/msg/TFMessage", transforms=transforms)


def _clock(_clock: m.Clock, stamp_ns: int) -> object:
    return ros.new("rosgraph_msgs/msg/Clock", clock=ros.time(stamp_ns))


def _description(
    description: m.RobotDescription | m.FixedFootDescription | m.StructureDescription, _stamp_ns: int
) -> object:
    return ros.string(description.urdf)


# ---- map


def _odometry(odometry: m.Odometry, stamp_ns: int) -> object:
    """The velocity is not estimated: NaN. A covariance of zeros means unknown, as sensor_msgs/Imu defines it."""
    unknown = np.zeros(36)
    covariance = unknown if odometry.covariance is None else odometry.covariance.reshape(-1)
    pose = ros.pose(odometry.T_frame_child)
    velocity = ros.vector([UNKNOWN] * 3)
    twist = ros.new("geometry_msgs/msg/Twist", linear=velocity, angular=velocity)
    return ros.new(
        "nav_msgs/msg/Odometry",
        header=ros.header(stamp_ns, odometry.frame),
        child_frame_id=odometry.child_frame,
        pose=ros.new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
        twist=ros.new("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
    )


def _map_status(status: m.MapStatus, stamp_ns: int) -> object:
    axes = list(status.degenerate_axes)
    unknown = {"fitness": _or_unknown(status.fitness), "leg_slip_m": _or_unknown(status.leg_slip_m)}
    return ros.own(status, stamp_ns, degenerate_axes=axes, **unknown)


def _plane_map(plane_map: m.PlaneMap, stamp_ns: int) -> object:
    return ros.own(plane_map, stamp_ns, planes=[_plane(plane) for plane in plane_map.planes])


def _plane(plane: m.Plane) -> object:
    corners = [ros.new("geometry_msgs/msg/Point32", x=x, y=y, z=z) for x, y, z in plane.outline_m.tolist()]
    red, green, blue = plane.colour.tolist()
    return ros.new(
        "hyrecro_msgs/msg/Plane",
        id=plane.id,
        coefficients=plane.coefficients,
        num_inliers=plane.num_inliers,
        outline=ros.new("geometry_msgs/msg/Polygon", points=corners),
        color=ros.new("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
    )


# ---- supervision


def _tracking_metrics(metrics: m.TrackingMetrics, stamp_ns: int) -> object:
    """Without a map the number of its points is 0."""
    names = ("rpe_rmse_rad", "drift_m", "map_accuracy_mean_m", "map_accuracy_p95_m")
    unknown = {name: _or_unknown(getattr(metrics, name)) for name in names}
    return ros.own(metrics, stamp_ns, **unknown, num_map_points=metrics.num_map_points or 0)


def _recorder_status(status: m.RecorderStatus, stamp_ns: int) -> object:
    return ros.own(status, stamp_ns, channels=[_channel_record(record) for record in status.channels])


def _channel_record(record: m.ChannelRecord) -> object:
    """What nobody counts is -1."""
    counts = dataclasses.asdict(record)
    return ros.new("hyrecro_msgs/msg/ChannelRecord", **counts | {"num_published": _or_minus_one(record.num_published)})


def _or_minus_one(count: int | None) -> int:
    return -1 if count is None else count


def _event(event: m.Event, stamp_ns: int) -> object:
    """The key of a refused command stands in `function`, which nothing else here uses."""
    return ros.new(
        "rcl_interfaces/msg/Log",
        stamp=ros.time(stamp_ns),
        level=LOG_LEVELS[event.severity],
        name=event.source,
        msg=event.text,
        file="",
        function=event.refused_key,
        line=0,
    )


def _health(health: m.Health, stamp_ns: int) -> object:
    """One DiagnosticStatus: the service's own numbers, then each key's counters as `<key> <counter>`."""
    values = {
        "uptime_s": f"{health.uptime_s:.3f}",
        "rss_bytes": str(health.rss_bytes),
        "busy_ratio": f"{health.busy_ratio:.3f}",
        "cpu_ratio": f"{health.cpu_ratio:.3f}",
        "num_open_files": str(health.num_open_files),
        "num_threads": str(health.num_threads),
        "shared_memory_bytes": str(health.shared_memory_bytes),
    }
    for count in health.channels:
        values |= {f"{count.key} {name}": str(getattr(count, name)) for name in _COUNTERS}
        known = {name: getattr(count, name) for name in _KNOWN_OR_NOT}
        values |= {f"{count.key} {name}": str(value) for name, value in known.items() if value is not None}
    status = ros.new(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=_DIAGNOSTIC_OK,
        name=health.service,
        message="",
        hardware_id="",
        values=[ros.new("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in values.items()],
    )
    header = ros.header(stamp_ns, health.frame)
    return ros.new("diagnostic_msgs/msg/DiagnosticArray", header=header, status=[status])


ROS_FORMS: Mapping[type[m.Message], RosForm] = {
    m.JointTarget: RosForm("sensor_msgs/msg/JointState", _joint_target),
    m.LegTarget: RosForm("std_msgs/msg/String", _leg_target),
    m.ActuatorTarget: RosForm("sensor_msgs/msg/JointState", _actuator_target),
    m.FootTarget: RosForm("geometry_msgs/msg/PoseStamped", _foot_target),
    m.Stop: RosForm("std_msgs/msg/String", _stop),
    m.SimControl: RosForm("std_msgs/msg/String", _control),
    m.RecorderControl: RosForm("std_msgs/msg/String", _control),
    m.ReplayControl: RosForm("std_msgs/msg/String", _control),
    m.JointState: RosForm("sensor_msgs/msg/JointState", _joints),
    m.ActuatorState: RosForm("sensor_msgs/msg/JointState", _actuators),
    m.LegState: RosForm("hyrecro_msgs/msg/LegState", _leg_state),
    m.FootStatus: RosForm("hyrecro_msgs/msg/FootStatus", _foot_status),
    m.Transforms: RosForm("tf2_msgs/msg/TFMessage", _transforms),
    m.Clock: RosForm("rosgraph_msgs/msg/Clock", _clock),
    m.RobotDescription: RosForm("std_msgs/msg/String", _description),
    m.FixedFootDescription: RosForm("std_msgs/msg/String", _description),
    m.StructureDescription: RosForm("std_msgs/msg/String", _description),
    m.LidarScan: RosForm("sensor_msgs/msg/PointCloud2", sensors.scan),
    m.Imu: RosForm("sensor_msgs/msg/Imu", sensors.imu),
    m.DepthImage: RosForm("sensor_msgs/msg/Image", sensors.depth_image),
    m.CameraInfo: RosForm("sensor_msgs/msg/CameraInfo", sensors.camera_info),
    m.PointCloud: RosForm("sensor_msgs/msg/PointCloud2", sensors.point_cloud),
    m.Odometry: RosForm("nav_msgs/msg/Odometry", _odometry),
    m.PlaneMap: RosForm("hyrecro_msgs/msg/PlaneMap", _plane_map),
    m.MapStatus: RosForm("hyrecro_msgs/msg/MapStatus", _map_status),
    m.TrackingMetrics: RosForm("hyrecro_msgs/msg/TrackingMetrics", _tracking_metrics),
    m.RecorderStatus: RosForm("hyrecro_msgs/msg/RecorderStatus", _recorder_status),
    m.Event: RosForm("rcl_interfaces/msg/Log", _event),
    m.Health: RosForm("diagnostic_msgs/msg/DiagnosticArray", _health),
}
"""Every recorded message type; the channel table names the same ROS types."""
