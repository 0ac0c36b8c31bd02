"""Messages of ROS sensors as ours: one function a type."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.sensors.sources.point_cloud import scan_of
from services.sensors.sources.topics import CAMERA_INFO, IMAGE, IMU, POINTS
from shared.messaging.messages import CameraInfo, DepthImage, Imu, Measurement

_MAX_DEPTH_MM = 65535


def image_of(image: Any, stamp_ns: int, seq: int, frame: str) -> DepthImage:
    """A depth image: `16UC1` or `mono16` in mm, `32FC1` in m. What is not finite or does not fit a pixel is 0.

    Raises:
        ValueError: another encoding, or rows that do not fit the data.
    """
    if image.encoding not in _PIXELS:
        raise ValueError(f"its encoding is {image.encoding}; a depth image has {', '.join(_PIXELS)}")
    dtype = np.dtype((">" if image.is_bigendian else "<") + _PIXELS[image.encoding])
    num_bytes = image.width * dtype.itemsize
    if image.step < num_bytes or len(image.data) < image.height * image.step:
        raise ValueError(f"its {len(image.data)} bytes do not hold {image.height} rows of {image.step} bytes")
    rows = np.asarray(image.data, dtype=np.uint8)[: image.height * image.step].reshape(image.height, image.step)
    pixels = np.ascontiguousarray(rows[:, :num_bytes]).reshape(-1).view(dtype)
    return DepthImage(
        stamp_ns=stamp_ns,
        seq=seq,
        frame=frame,
        height=int(image.height),
        width=int(image.width),
        depth_mm=_millimetres(pixels) if dtype.kind == "f" else pixels.astype(np.uint16),
    )


def camera_info_of(info: Any, stamp_ns: int, seq: int, frame: str) -> CameraInfo:
    """The intrinsics K. A distortion is left out: depth images come without."""
    K = info.k if hasattr(info, "k") else info.K  # ROS 1 wrote it large
    return CameraInfo(
        stamp_ns=stamp_ns,
        seq=seq,
        frame=frame,
        height=int(info.height),
        width=int(info.width),
        fx=float(K[0]),
        fy=float(K[4]),
        cx=float(K[2]),
        cy=float(K[5]),
    )


def imu_of(imu: Any, stamp_ns: int, seq: int, frame: str) -> Imu:
    """Rates and accelerations, taken to be along the axes of `frame`."""
    return Imu(
        stamp_ns=stamp_ns,
        seq=seq,
        frame=frame,
        angular_velocity_radps=_xyz(imu.angular_velocity),
        linear_acceleration_mps2=_xyz(imu.linear_acceleration),
    )


def _millimetres(depth_m: NDArray[np.floating[Any]]) -> NDArray[np.uint16]:
    with np.errstate(invalid="ignore", over="ignore"):
        depth_mm = np.round(depth_m.astype(np.float64) * 1000)
        is_depth = (depth_mm > 0) & (depth_mm <= _MAX_DEPTH_MM)
    return np.where(is_depth, depth_mm, 0).astype(np.uint16)


def _xyz(vector: Any) -> NDArray[np.float64]:
    return np.array([vector.x, vector.y, vector.z], dtype=np.float64)


_PIXELS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
CONVERSIONS: dict[str, Callable[[Any, int, int, str], Measurement]] = {
    POINTS: scan_of,
    IMAGE: image_of,
    CAMERA_INFO: camera_info_of,
    IMU: imu_of,
}
"""ROS type -> function of the ROS message, the stamp in its header, the number and the frame it gets."""
