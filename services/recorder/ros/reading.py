"""ROS 2 CDR bytes as messages again: the other way of `messages`.

What a ROS type has no place for comes back as its default: a clock's pace, a depth image's ground truth, the frame of
a description, which is its root link. Of commands see `command_reading`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from services.recorder.ros import command_reading as commands, schemas as ros, sensor_reading as sensors
from services.recorder.ros.messages import LOG_LEVELS
from services.recorder.ros.sensor_reading import stamp_ns_of
from shared.errors import MessageError
from shared.messaging import messages as m
from shared.messaging.channels import Channel
from shared.xml_reading import XmlError, root_of


def from_cdr(channel: Channel, data: bytes, seq: int, stamp_ns: int = 0) -> m.Message:
    """The message of a channel that was recorded as these bytes.

    stamp_ns: of the record, for what its ROS type has no time for: descriptions.

    Raises:
        ValueError: the channel's messages cannot be read back.
        MessageError: the bytes are not such a message.
    """
    read = _FROM_ROS.get(channel.message)
    if read is None:
        raise ValueError(f"{channel.key}: its messages cannot be read back from a recording")
    try:
        message = read(ros.typestore().deserialize_cdr(data, channel.ros_type), seq)
        if isinstance(message, m.RobotDescription | m.FixedFootDescription | m.StructureDescription):
            return replace(message, stamp_ns=stamp_ns)
    except Exception as error:  # the ROS library and numpy raise anything on bytes that are not what they should be
        raise MessageError(" ".join(str(error).split()) or type(error).__name__) from error
    return message


def _pose(position: Any, orientation: Any) -> list[float]:
    p, q = position, orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def _transforms(ros_message: Any, seq: int) -> m.Transforms:
    edges = ros_message.transforms
    return m.Transforms(
        stamp_ns=stamp_ns_of(edges[0].header.stamp) if edges else 0,
        seq=seq,
        frame=edges[0].header.frame_id if edges else "",
        parents=tuple(edge.header.frame_id for edge in edges),
        children=tuple(edge.child_frame_id for edge in edges),
        T_parent_child=np.array([_pose(e.transform.translation, e.transform.rotation) for e in edges]).reshape(-1, 7),
    )


def _odometry(ros_message: Any, seq: int) -> m.Odometry:
    covariance = ros_message.pose.covariance.reshape(6, 6)
    pose = ros_message.pose.pose
    return m.Odometry(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        child_frame=ros_message.child_frame_id,
        T_frame_child=np.array(_pose(pose.position, pose.orientation)),
        covariance=covariance if covariance.any() else None,
    )


def _map_status(ros_message: Any, seq: int) -> m.MapStatus:
    names = [name for name in m.MapStatus.__dataclass_fields__ if name not in ("stamp_ns", "seq", "frame")]
    values = {name: getattr(ros_message, name) for name in names}
    values["degenerate_axes"] = tuple(values["degenerate_axes"])
    values["fitness"], values["leg_slip_m"] = _known(values["fitness"]), _known(values["leg_slip_m"])
    header = ros_message.header
    return m.MapStatus(stamp_ns=stamp_ns_of(header.stamp), seq=seq, frame=header.frame_id, **values)


def _known(value: float) -> float | None:
    return None if np.isnan(value) else value


def _leg_state(ros_message: Any, seq: int) -> m.LegState:
    force, torque = ros_message.wrench.force, ros_message.wrench.torque
    wrench = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    pose = ros_message.foot_pose
    return m.LegState(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        fixed_foot=m.Foot(ros_message.fixed_foot),
        T_world_foot=np.array(_pose(pose.position, pose.orientation)),
        has_contact=ros_message.has_contact if ros_message.is_contact_known else None,
        holding=tuple(m.Foot(foot) for foot in ros_message.holding) if ros_message.is_holding_known else None,
        wrench=None if np.isnan(wrench).any() else wrench,
        load_n=_known(ros_message.load_n),
        margin=_known(ros_message.margin),
    )


def _joint_state(ros_message: Any, seq: int) -> m.JointState:
    return m.JointState(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        q=ros_message.position,
        dq=ros_message.velocity,
        effort=ros_message.effort if len(ros_message.effort) else None,
    )


def _robot(ros_message: Any, seq: int) -> m.RobotDescription:
    return m.RobotDescription(stamp_ns=0, seq=seq, frame=_root_link(ros_message.data), urdf=ros_message.data)


def _fixed_foot(ros_message: Any, seq: int) -> m.FixedFootDescription:
    return m.FixedFootDescription(stamp_ns=0, seq=seq, frame=_root_link(ros_message.data), urdf=ros_message.data)


def _root_link(urdf: str) -> str:
    """The link of a URDF that is no joint's child; "" where there is none."""
    try:
        robot = root_of(urdf, "robot")
    except XmlError:
        return ""
    children = {child.get("link") for child in robot.findall("joint/child")}
    return next((name for link in robot.findall("link") if (name := link.get("name", "")) not in children), "")


def _actuators(ros_message: Any, seq: int) -> m.ActuatorState:
    return m.ActuatorState(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        positions=ros_message.position,
        velocities=ros_message.velocity,
    )


def _foot_status(ros_message: Any, seq: int) -> m.FootStatus:
    goal = ros_message.goal
    return m.FootStatus(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        foot=m.Foot(ros_message.foot),
        phase=m.FootPhase(ros_message.phase),
        progress=ros_message.progress,
        text=ros_message.text,
        T_world_goal=np.array(_pose(goal.position, goal.orientation)) if ros_message.is_goal_known else None,
        duration_s=_known(ros_message.duration_s),
        margin=_known(ros_message.margin),
    )


def _clock(ros_message: Any, seq: int) -> m.Clock:
    return m.Clock(stamp_ns=stamp_ns_of(ros_message.clock), seq=seq, frame="")


def _plane_map(ros_message: Any, seq: int) -> m.PlaneMap:
    header = ros_message.header
    planes = tuple(_plane(plane) for plane in ros_message.planes)
    return m.PlaneMap(stamp_ns=stamp_ns_of(header.stamp), seq=seq, frame=header.frame_id, planes=planes)


def _plane(ros_plane: Any) -> m.Plane:
    colour = ros_plane.color
    return m.Plane(
        id=ros_plane.id,
        coefficients=ros_plane.coefficients,
        num_inliers=ros_plane.num_inliers,
        outline_m=np.array([[p.x, p.y, p.z] for p in ros_plane.outline.points]).reshape(-1, 3),
        colour=np.array([colour.r, colour.g, colour.b]),
    )


def _metrics(ros_message: Any, seq: int) -> m.TrackingMetrics:
    names = [name for name in m.TrackingMetrics.__dataclass_fields__ if name not in ("stamp_ns", "seq", "frame")]
    values = {name: getattr(ros_message, name) for name in names}
    for name in ("rpe_rmse_rad", "drift_m", "map_accuracy_mean_m", "map_accuracy_p95_m"):
        values[name] = _known(values[name])
    values["num_map_points"] = values["num_map_points"] or None
    header = ros_message.header
    return m.TrackingMetrics(stamp_ns=stamp_ns_of(header.stamp), seq=seq, frame=header.frame_id, **values)


def _recorder_status(ros_message: Any, seq: int) -> m.RecorderStatus:
    names = ("is_recording", "path", "num_files", "num_bytes", "free_bytes", "text")
    header = ros_message.header
    return m.RecorderStatus(
        stamp_ns=stamp_ns_of(header.stamp),
        seq=seq,
        frame=header.frame_id,
        channels=tuple(_channel_record(record) for record in ros_message.channels),
        **{name: getattr(ros_message, name) for name in names},
    )


def _channel_record(ros_record: Any) -> m.ChannelRecord:
    values = {name: getattr(ros_record, name) for name in m.ChannelRecord.__dataclass_fields__}
    values["num_published"] = None if values["num_published"] < 0 else values["num_published"]
    return m.ChannelRecord(**values)


def _event(ros_message: Any, seq: int) -> m.Event:
    return m.Event(
        stamp_ns=stamp_ns_of(ros_message.stamp),
        seq=seq,
        frame="",
        source=ros_message.name,
        severity=next(severity for severity, level in LOG_LEVELS.items() if level == ros_message.level),
        text=ros_message.msg,
        refused_key=ros_message.function,
    )


def _structure(ros_message: Any, seq: int) -> m.StructureDescription:
    return m.StructureDescription(stamp_ns=0, seq=seq, frame="world", urdf=ros_message.data)


def _health(ros_message: Any, seq: int) -> m.Health:
    (status,) = ros_message.status
    values = {pair.key: pair.value for pair in status.values}
    counts: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        key, _, counter = name.rpartition(" ")
        if key:
            counts.setdefault(key, {})[counter] = float(value) if counter.endswith("_s") else int(value)
    return m.Health(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        service=status.name,
        uptime_s=float(values["uptime_s"]),
        rss_bytes=int(values["rss_bytes"]),
        busy_ratio=float(values["busy_ratio"]),
        channels=tuple(m.ChannelCount(key=key, **counters) for key, counters in counts.items()),
        cpu_ratio=float(values.get("cpu_ratio", 0.0)),  # recordings of before have none of these
        **{name: int(values.get(name, 0)) for name in ("num_open_files", "num_threads", "shared_memory_bytes")},
    )


_FROM_ROS: dict[type[m.Message], Callable[[Any, int], m.Message]] = {
    m.JointState: _joint_state,
    m.Imu: sensors.imu,
    m.DepthImage: sensors.depth_image,
    m.CameraInfo: sensors.camera_info,
    m.RobotDescription: _robot,
    m.JointTarget: commands.joint_target,
    m.LegTarget: commands.leg_target,
    m.ActuatorTarget: commands.actuator_target,
    m.FootTarget: commands.foot_target,
    m.Stop: commands.stop,
    m.SimControl: commands.control(m.SimControl),
    m.RecorderControl: commands.control(m.RecorderControl),
    m.ReplayControl: commands.control(m.ReplayControl),
    m.ActuatorState: _actuators,
    m.LegState: _leg_state,
    m.FootStatus: _foot_status,
    m.Clock: _clock,
    m.FixedFootDescription: _fixed_foot,
    m.PlaneMap: _plane_map,
    m.TrackingMetrics: _metrics,
    m.RecorderStatus: _recorder_status,
    m.Event: _event,
    m.Transforms: _transforms,
    m.LidarScan: sensors.scan,
    m.PointCloud: sensors.cloud,
    m.Odometry: _odometry,
    m.MapStatus: _map_status,
    m.StructureDescription: _structure,
    m.Health: _health,
}
