"""The points of LAS files, versions 1.0 to 1.4; written as 1.2 in point format 0, or 2 with colours.

Places stand in the first bytes of every point format, so one reader serves them all. Compressed LAZ is not read.
Source: ASPRS, LAS Specification 1.2 (2008) and 1.4-R15 (2019), public header block and point data records.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared.pcd_format import Columns

_HEADER_BYTES = 227
_MIN_RECORD_BYTES = 20
_SCALE_M = 1e-5
"""Of what is written: 10 micrometres, which reach 21 km to each side of the middle."""
_MAX_SCALE, _MAX_OFFSET_M = 1e3, 1e12
_HEADER = np.dtype(
    [
        ("signature", "S4"),
        ("source", "<u2"),
        ("encoding", "<u2"),
        ("guid", "V16"),
        ("version", "u1", 2),
        ("system", "S32"),
        ("software", "S32"),
        ("day", "<u2"),
        ("year", "<u2"),
        ("header_bytes", "<u2"),
        ("points_at", "<u4"),
        ("num_records", "<u4"),
        ("point_format", "u1"),
        ("record_bytes", "<u2"),
        ("num_points", "<u4"),
        ("num_by_return", "<u4", 5),
        ("scale", "<f8", 3),
        ("offset", "<f8", 3),
        ("max_min", "<f8", (3, 2)),
    ]
)
_RECORDS = {
    0: np.dtype([("xyz", "<i4", 3), ("intensity", "<u2"), ("rest", "u1", 6)]),
    2: np.dtype([("xyz", "<i4", 3), ("intensity", "<u2"), ("rest", "u1", 6), ("rgb", "<u2", 3)]),
}


def parse_las(content: bytes) -> Columns:
    """x, y, z in metres and intensity, each (N,).

    Raises:
        ValueError: saying what is wrong with the content.
    """
    if content[:4] != b"LASF":
        raise ValueError("not a LAS file")
    if len(content) < _HEADER_BYTES:
        raise ValueError("the header is cut off")
    header = np.frombuffer(content, _HEADER, 1)[0]
    if header["point_format"] & 0xC0:
        raise ValueError("compressed points (LAZ) are not read; decompress it first")
    num_points, record_bytes = _num_points(header, content), int(header["record_bytes"])
    if record_bytes < _MIN_RECORD_BYTES:
        raise ValueError(f"a point is said to have {record_bytes} bytes, at least {_MIN_RECORD_BYTES} are needed")
    scale, offset = header["scale"], header["offset"]
    if not ((np.abs(scale) > 0) & (np.abs(scale) < _MAX_SCALE) & (np.abs(offset) < _MAX_OFFSET_M)).all():
        raise ValueError(f"scale {scale.tolist()} or offset {offset.tolist()} cannot be one of metres")
    num_present = max(len(content) - int(header["points_at"]), 0) // record_bytes
    if num_present < num_points:
        raise ValueError(f"the header says {num_points} points, the data hold {num_present}: cut off")
    record = np.dtype({"names": ["xyz", "intensity"], "formats": [("<i4", 3), "<u2"], "itemsize": record_bytes})
    points = np.frombuffer(content, record, num_points, int(header["points_at"]) if num_points else 0)
    xyz = points["xyz"] * scale + offset
    return {"x": xyz[:, 0], "y": xyz[:, 1], "z": xyz[:, 2], "intensity": points["intensity"]}


def _num_points(header: np.void, content: bytes) -> int:
    is_1_4 = tuple(header["version"]) >= (1, 4)
    if is_1_4 and len(content) >= 255:
        return int(np.frombuffer(content, "<u8", 1, 247)[0])
    return int(header["num_points"])


def las_bytes(points_m: NDArray[np.floating], colours: NDArray[np.uint8] | None = None) -> bytes:
    """Points (N, 3) to 10 micrometres, or coarser where they reach far, with colours (N, 3) where given.

    Raises:
        ValueError: a coordinate is not finite, which the format cannot hold.
    """
    points_m = points_m.astype(np.float64)
    if not np.isfinite(points_m).all():
        raise ValueError("LAS holds finite coordinates only")
    low, high = (points_m.min(axis=0), points_m.max(axis=0)) if len(points_m) else (np.zeros(3), np.zeros(3))
    offset = np.round((low + high) / 2)
    scale = max(_SCALE_M, float(np.abs([low - offset, high - offset]).max()) / 2**30)
    point_format = 0 if colours is None else 2
    points = np.zeros(len(points_m), _RECORDS[point_format])
    points["xyz"] = np.round((points_m - offset) / scale)
    points["rest"][:, 0] = 0b001001  # return 1 of 1
    if colours is not None:
        points["rgb"] = colours.astype(np.uint16) * 257
    header = np.zeros(1, _HEADER)
    header["signature"], header["version"], header["software"] = b"LASF", (1, 2), b"hyrecro"
    header["header_bytes"] = header["points_at"] = _HEADER_BYTES
    header["point_format"], header["record_bytes"] = point_format, points.dtype.itemsize
    header["num_points"] = header["num_by_return"][:, 0] = len(points)
    header["scale"], header["offset"] = scale, offset
    header["max_min"] = np.column_stack([high, low])
    return header.tobytes() + points.tobytes()
