"""What sensors measure as ROS 2 messages: clouds, images, inertial measurements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.recorder.ros import schemas as ros
from shared.messaging import messages as m

_XYZ = ("x", "y", "z")
_SCAN = (*_XYZ, "intensity", "t", "ring")
_TRUTH = ("member", "face", "true_range_m")
_FORMATS = {"t": "<u4", "ring": "<u2", "member": "<i4", "face": "<i4"}
"""Of a point's fields; all others are <f4."""
_POINT_FIELD_TYPES = {"<u2": 4, "<i4": 5, "<u4": 6, "<f4": 7}
"""sensor_msgs/msg/PointField: datatype constants."""


def _cloud(header: object, table: NDArray[np.void]) -> object:
    """sensor_msgs/PointCloud2 of a structured array (N,): unorganised (one row) and without invalid points."""
    fields = table.dtype.fields
    assert fields is not None
    return ros.new(
        "sensor_msgs/msg/PointCloud2",
        header=header,
        height=1,
        width=len(table),
        fields=[
            ros.new(
                "sensor_msgs/msg/PointField", name=name, offset=of[1], datatype=_POINT_FIELD_TYPES[of[0].str], count=1
            )
            for name, of in fields.items()
        ],
        is_bigendian=False,
        point_step=table.itemsize,
        row_step=table.nbytes,
        data=table.view(np.uint8),
        is_dense=True,
    )


def _dtype(names: tuple[str, ...]) -> np.dtype[np.void]:
    """Of points with these fields, one every four bytes."""
    formats = [_FORMATS.get(name, "<f4") for name in names]
    return np.dtype({"names": list(names), "formats": formats, "offsets": [4 * i for i in range(len(names))]})


def scan(scan: m.LidarScan, stamp_ns: int) -> object:
    """Ground truth that the scan has stands in further fields of each point: member, face, true_range_m."""
    truth = tuple(name for name in _TRUTH if getattr(scan, name) is not None)
    table = np.zeros(len(scan.points_m), _dtype((*_SCAN, *truth)))
    for axis, name in enumerate(_XYZ):
        table[name] = scan.points_m[:, axis]
    table["intensity"], table["t"], table["ring"] = scan.intensity, scan.t_ns, scan.ring
    for name in truth:
        table[name] = getattr(scan, name)
    return _cloud(ros.header(stamp_ns, scan.frame), table)


def point_cloud(cloud: m.PointCloud, stamp_ns: int) -> object:
    """Points of x, y, z."""
    table = np.ascontiguousarray(cloud.points_m, dtype="<f4").view(_dtype(_XYZ)).reshape(-1)
    return _cloud(ros.header(stamp_ns, cloud.frame), table)


def imu(imu: m.Imu, stamp_ns: int) -> object:
    """The orientation is not measured: -1 in its covariance says so. Covariances of zeros mean unknown.

    Source: sensor_msgs/msg/Imu.
    """
    not_measured = np.zeros(9)
    not_measured[0] = -1.0
    return ros.new(
        "sensor_msgs/msg/Imu",
        header=ros.header(stamp_ns, imu.frame),
        orientation=ros.quaternion([0.0, 0.0, 0.0, 1.0]),
        orientation_covariance=not_measured,
        angular_velocity=ros.vector(imu.angular_velocity_radps.tolist()),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=ros.vector(imu.linear_acceleration_mps2.tolist()),
        linear_acceleration_covariance=np.zeros(9),
    )


def depth_image(image: m.DepthImage, stamp_ns: int) -> object:
    """Millimetres as uint16, 0 = none (REP-118's 16UC1). An Image has no place for ground truth: it is not recorded."""
    return ros.new(
        "sensor_msgs/msg/Image",
        header=ros.header(stamp_ns, image.frame),
        height=image.height,
        width=image.width,
        encoding="16UC1",
        is_bigendian=0,
        step=2 * image.width,
        data=np.ascontiguousarray(image.depth_mm, dtype="<u2").view(np.uint8),
    )


def camera_info(info: m.CameraInfo, stamp_ns: int) -> object:
    """A rectified camera: no distortion, so P is K with a column of zeros."""
    K = np.array([[info.fx, 0.0, info.cx], [0.0, info.fy, info.cy], [0.0, 0.0, 1.0]])
    roi = ros.new("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return ros.new(
        "sensor_msgs/msg/CameraInfo",
        header=ros.header(stamp_ns, info.frame),
        height=info.height,
        width=info.width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=K.reshape(-1),
        r=np.eye(3).reshape(-1),
        p=np.column_stack([K, np.zeros(3)]).reshape(-1),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )
