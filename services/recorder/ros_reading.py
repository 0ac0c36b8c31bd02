"""ROS 2 CDR bytes as messages again: the other way of `ros_messages`, for what reports need."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from services.recorder import ros_schemas as ros
from services.recorder.ros_messages import LOG_LEVELS
from shared.messaging import messages as m
from shared.messaging.channels import Channel


def from_cdr(channel: Channel, data: bytes, seq: int) -> m.Message:
    """The message of a channel that was recorded as these bytes.

    Raises:
        ValueError: the channel's messages cannot be read back.
    """
    read = _FROM_ROS.get(channel.message)
    if read is None:
        raise ValueError(f"{channel.key}: its messages cannot be read back from a recording")
    return read(ros.typestore().deserialize_cdr(data, channel.ros_type), seq)


def _stamp_ns(stamp: Any) -> int:
    return int(stamp.sec) * ros.NS_PER_S + int(stamp.nanosec)


def _pose(position: Any, orientation: Any) -> list[float]:
    p, q = position, orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def _transforms(ros_message: Any, seq: int) -> m.Transforms:
    edges = ros_message.transforms
    return m.Transforms(
        stamp_ns=_stamp_ns(edges[0].header.stamp) if edges else 0,
        seq=seq,
        frame=edges[0].header.frame_id if edges else "",
        parents=tuple(edge.header.frame_id for edge in edges),
        children=tuple(edge.child_frame_id for edge in edges),
        T_parent_child=np.array([_pose(e.transform.translation, e.transform.rotation) for e in edges]).reshape(-1, 7),
    )


def _columns(ros_message: Any) -> Any:
    formats = {field.name: (_DATATYPES[field.datatype], field.offset) for field in ros_message.fields}
    dtype = np.dtype(
        {
            "names": list(formats),
            "formats": [format_ for format_, _ in formats.values()],
            "offsets": [offset for _, offset in formats.values()],
            "itemsize": ros_message.point_step,
        }
    )
    return np.frombuffer(ros_message.data, dtype=dtype)


_DATATYPES = {4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4"}  # sensor_msgs/msg/PointField


def _scan(ros_message: Any, seq: int) -> m.LidarScan:
    table = _columns(ros_message)
    truth = {name: table[name] for name in ("member", "face", "true_range_m") if name in table.dtype.names}
    return m.LidarScan(
        stamp_ns=_stamp_ns(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        points_m=np.stack([table["x"], table["y"], table["z"]], axis=1),
        intensity=table["intensity"],
        t_ns=table["t"],
        ring=table["ring"],
        **truth,
    )


def _cloud(ros_message: Any, seq: int) -> m.PointCloud:
    table = _columns(ros_message)
    return m.PointCloud(
        stamp_ns=_stamp_ns(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        points_m=np.stack([table["x"], table["y"], table["z"]], axis=1),
    )


def _odometry(ros_message: Any, seq: int) -> m.Odometry:
    covariance = ros_message.pose.covariance.reshape(6, 6)
    pose = ros_message.pose.pose
    return m.Odometry(
        stamp_ns=_stamp_ns(ros_message.header.stamp),
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
    return m.MapStatus(stamp_ns=_stamp_ns(header.stamp), seq=seq, frame=header.frame_id, **values)


def _known(value: float) -> float | None:
    return None if np.isnan(value) else value


def _leg_state(ros_message: Any, seq: int) -> m.LegState:
    force, torque = ros_message.wrench.force, ros_message.wrench.torque
    wrench = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    pose = ros_message.foot_pose
    return m.LegState(
        stamp_ns=_stamp_ns(ros_message.header.stamp),
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
        stamp_ns=_stamp_ns(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        q=ros_message.position,
        dq=ros_message.velocity,
        effort=ros_message.effort if len(ros_message.effort) else None,
    )


def _imu(ros_message: Any, seq: int) -> m.Imu:
    rate, acceleration = ros_message.angular_velocity, ros_message.linear_acceleration
    return m.Imu(
        stamp_ns=_stamp_ns(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        angular_velocity_radps=np.array([rate.x, rate.y, rate.z]),
        linear_acceleration_mps2=np.array([acceleration.x, acceleration.y, acceleration.z]),
    )


def _depth_image(ros_message: Any, seq: int) -> m.DepthImage:
    return m.DepthImage(
        stamp_ns=_stamp_ns(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        height=ros_message.height,
        width=ros_message.width,
        depth_mm=ros_message.data.view("<u2"),
    )


def _camera_info(ros_message: Any, seq: int) -> m.CameraInfo:
    K = ros_message.k.reshape(3, 3)
    return m.CameraInfo(
        stamp_ns=_stamp_ns(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        height=ros_message.height,
        width=ros_message.width,
        fx=K[0, 0],
        fy=K[1, 1],
        cx=K[0, 2],
        cy=K[1, 2],
    )


def _robot(ros_message: Any, seq: int) -> m.RobotDescription:
    """A std_msgs/String has neither time nor frame: the robot's root link is named in its URDF."""
    return m.RobotDescription(stamp_ns=0, seq=seq, frame="", urdf=ros_message.data)


def _event(ros_message: Any, seq: int) -> m.Event:
    return m.Event(
        stamp_ns=_stamp_ns(ros_message.stamp),
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
    counts: dict[str, dict[str, int]] = {}
    for name, value in values.items():
        key, _, counter = name.rpartition(" ")
        if key:
            counts.setdefault(key, {})[counter] = int(value)
    return m.Health(
        stamp_ns=_stamp_ns(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        service=status.name,
        uptime_s=float(values["uptime_s"]),
        rss_bytes=int(values["rss_bytes"]),
        busy_ratio=float(values["busy_ratio"]),
        channels=tuple(m.ChannelCount(key=key, **counters) for key, counters in counts.items()),
    )


_FROM_ROS: dict[type[m.Message], Callable[[Any, int], m.Message]] = {
    m.JointState: _joint_state,
    m.Imu: _imu,
    m.DepthImage: _depth_image,
    m.CameraInfo: _camera_info,
    m.RobotDescription: _robot,
    m.LegState: _leg_state,
    m.Event: _event,
    m.Transforms: _transforms,
    m.LidarScan: _scan,
    m.PointCloud: _cloud,
    m.Odometry: _odometry,
    m.MapStatus: _map_status,
    m.StructureDescription: _structure,
    m.Health: _health,
}
