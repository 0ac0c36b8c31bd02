"""ROS 2 messages of sensors as ours again: the other way of `sensors`."""

from __future__ import annotations

from typing import Any

import numpy as np

from services.recorder.ros import schemas as ros
from shared.messaging import messages as m


def stamp_ns_of(stamp: Any) -> int:
    """Nanoseconds of a builtin_interfaces/Time."""
    return int(stamp.sec) * ros.NS_PER_S + int(stamp.nanosec)


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


def scan(ros_message: Any, seq: int) -> m.LidarScan:
    """Ground truth stands in further fields, where there is any."""
    table = _columns(ros_message)
    truth = {name: table[name] for name in ("member", "face", "true_range_m") if name in table.dtype.names}
    return m.LidarScan(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        points_m=np.stack([table["x"], table["y"], table["z"]], axis=1),
        intensity=table["intensity"],
        t_ns=table["t"],
        ring=table["ring"],
        **truth,
    )


def cloud(ros_message: Any, seq: int) -> m.PointCloud:
    """Points of x, y, z."""
    table = _columns(ros_message)
    return m.PointCloud(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        points_m=np.stack([table["x"], table["y"], table["z"]], axis=1),
    )


def imu(ros_message: Any, seq: int) -> m.Imu:
    """The orientation is not measured."""
    rate, acceleration = ros_message.angular_velocity, ros_message.linear_acceleration
    return m.Imu(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        angular_velocity_radps=np.array([rate.x, rate.y, rate.z]),
        linear_acceleration_mps2=np.array([acceleration.x, acceleration.y, acceleration.z]),
    )


def depth_image(ros_message: Any, seq: int) -> m.DepthImage:
    """An Image has no place for ground truth: it has none."""
    return m.DepthImage(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        height=ros_message.height,
        width=ros_message.width,
        depth_mm=ros_message.data.view("<u2"),
    )


def camera_info(ros_message: Any, seq: int) -> m.CameraInfo:
    """The focal lengths and the centre are those of K."""
    K = ros_message.k.reshape(3, 3)
    return m.CameraInfo(
        stamp_ns=stamp_ns_of(ros_message.header.stamp),
        seq=seq,
        frame=ros_message.header.frame_id,
        height=ros_message.height,
        width=ros_message.width,
        fx=K[0, 0],
        fy=K[1, 1],
        cx=K[0, 2],
        cy=K[1, 2],
    )
