"""Recordings of real sensors in small: messages of ROS 2, and files of them by the libraries' own writers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer as McapWriter
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
_DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}

Said = tuple[str, Any]
"""A topic and its ROS message."""


def ros(ros_type: str, /, **fields: Any) -> Any:
    return STORE.types[ros_type](**fields)


def header(stamp_ns: int) -> Any:
    time = ros("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return ros("std_msgs/msg/Header", stamp=time, frame_id="somewhere")


def cloud(table: NDArray[Any], stamp_ns: int, *, height: int = 1, row_padding: int = 0) -> Any:
    """The records of a table (N,) as PointCloud2, in `height` rows with padding behind each."""
    fields = []
    for name in table.dtype.names or ():
        dtype, offset = table.dtype.fields[name][:2]
        kind = f"{dtype.kind}{dtype.itemsize}"
        fields.append(ros("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=_DATATYPES[kind], count=1))
    rows = table.reshape(height, -1).view(np.uint8).reshape(height, -1)
    rows = np.pad(rows, ((0, 0), (0, row_padding)), constant_values=255)
    return ros(
        "sensor_msgs/msg/PointCloud2",
        header=header(stamp_ns),
        height=height,
        width=len(table) // height,
        fields=fields,
        is_bigendian=table.dtype[0].byteorder == ">",
        point_step=table.itemsize,
        row_step=rows.shape[1],
        data=rows.reshape(-1),
        is_dense=True,
    )


def image(pixels: NDArray[Any], encoding: str, stamp_ns: int) -> Any:
    return ros(
        "sensor_msgs/msg/Image",
        header=header(stamp_ns),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=int(pixels.dtype.byteorder == ">"),
        step=pixels.shape[1] * pixels.itemsize,
        data=np.ascontiguousarray(pixels).view(np.uint8).reshape(-1),
    )


def camera_info(height: int, width: int, K: NDArray[np.float64], stamp_ns: int) -> Any:
    roi = ros("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return ros(
        "sensor_msgs/msg/CameraInfo",
        header=header(stamp_ns),
        height=height,
        width=width,
        distortion_model="",
        d=np.zeros(0),
        k=K.reshape(-1),
        r=np.eye(3).reshape(-1),
        p=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )


def imu(gyro: tuple[float, float, float], accel: tuple[float, float, float], stamp_ns: int) -> Any:
    vector = STORE.types["geometry_msgs/msg/Vector3"]
    return ros(
        "sensor_msgs/msg/Imu",
        header=header(stamp_ns),
        orientation=ros("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.zeros(9),
        angular_velocity=vector(*gyro),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(*accel),
        linear_acceleration_covariance=np.zeros(9),
    )


def text(data: str) -> Any:
    return ros("std_msgs/msg/String", data=data)


def write_bag(folder: Path, plugin: StoragePlugin, said: Iterable[Said]) -> Path:
    """A rosbag2 folder."""
    connections: dict[str, Any] = {}
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        for i, (topic, message) in enumerate(said):
            name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=STORE)
            writer.write(connections[topic], i, STORE.serialize_cdr(message, name))
    return folder


def write_mcap(path: Path, said: Iterable[Said], *, chunk_bytes: int = 1, use_index: bool = True) -> Path:
    """An MCAP file: a chunk a message, unless told otherwise; without a summary at its end, if so wanted."""
    channels: dict[str, int] = {}
    with path.open("wb") as file:
        options = dict.fromkeys(("use_summary_offsets", "repeat_channels", "repeat_schemas"), use_index)
        writer = McapWriter(file, chunk_size=chunk_bytes, **options)
        writer.start(profile="ros2")
        for i, (topic, message) in enumerate(said):
            name = message.__msgtype__
            if topic not in channels:
                definition = STORE.generate_msgdef(name, ros_version=2)[0].encode()
                schema = writer.register_schema(name=name, encoding="ros2msg", data=definition)
                channels[topic] = writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
            writer.add_message(channels[topic], i, bytes(STORE.serialize_cdr(message, name)), i)
        writer.finish()
    return path
