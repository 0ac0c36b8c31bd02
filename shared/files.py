"""Texts, clouds and trajectories as files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared.errors import InputFileError
from shared.geometry import SE3
from shared.messaging.messages import LidarScan


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        InputFileError: it cannot be read or is not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise InputFileError(f"{path}: not UTF-8 text: {error}") from error


def write_pcd(path: Path, points_m: NDArray[np.floating]) -> None:
    """Points (N, 3) as a binary PCD of float32 x y z."""
    from pypcd4 import PointCloud

    PointCloud.from_xyz_points(points_m.astype(np.float32)).save(path)


def write_scan(path: Path, scan: LidarScan) -> None:
    """A scan as a binary PCD with the fields that LiDAR users know: x y z intensity t (ns in the scan) ring."""
    from pypcd4 import Encoding, PointCloud

    columns = [*scan.points_m.T, scan.intensity, scan.t_ns, scan.ring]
    fields = ("x", "y", "z", "intensity", "t", "ring")
    types = (np.float32, np.float32, np.float32, np.float32, np.uint32, np.uint16)
    PointCloud.from_points(columns, fields, types).save(path, encoding=Encoding.BINARY)


def write_tum(path: Path, poses: Iterable[tuple[int, SE3]]) -> None:
    """Stamped poses in the TUM format, `t x y z qx qy qz qw`, seconds and metres at full precision."""
    with path.open("w", encoding="ascii") as file:
        for stamp_ns, pose in poses:
            values = " ".join(repr(float(value)) for value in pose.xyz_quat_xyzw)
            file.write(f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d} {values}\n")
