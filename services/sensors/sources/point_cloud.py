"""A sensor_msgs/PointCloud2 of any make as a scan."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.messaging.messages import LidarScan

_FORMATS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Source: sensor_msgs/msg/PointField."""
_INTENSITIES = ("intensity", "reflectivity")
_TIMES = ("t", "time", "timestamp")
"""As the drivers of Ouster; Velodyne; Hesai, RoboSense and Livox call it."""
_MAX_T_NS = 2**32 - 1
_ABSOLUTE_NS = 10 * 10**9
"""A time in the scan that is later than this counts from elsewhere."""
_MIN_FLOAT_NS = 1e12
"""A floating-point time from here on is in nanoseconds, as Livox gives it: in seconds it would be 30,000 years."""


def scan_of(cloud: Any, stamp_ns: int, seq: int, frame: str) -> LidarScan:
    """The points that are finite and not at the origin, ring by ring where rings are known.

    stamp_ns: of the header. The scan's is earlier if a point is, by the points' own times. Missing fields are zeros.

    Raises:
        ValueError: x, y or z is missing, the fields do not fit the data, or times span more than 4.29 s.
    """
    table = _table(cloud)
    points_m = np.stack([table[name].astype(np.float32) for name in "xyz"], axis=-1)
    kept = np.flatnonzero(np.isfinite(points_m).all(axis=1) & points_m.any(axis=1))
    ring = _column(table, ("ring",), kept)
    if np.any(np.diff(ring.astype(np.int64)) < 0):
        order = np.argsort(ring, kind="stable")
        kept, ring = kept[order], ring[order]
    offset_ns = _offsets_ns(_column(table, _TIMES, kept), stamp_ns)
    earliest_ns = min(0, int(offset_ns.min(initial=0)))
    t_ns = offset_ns - earliest_ns
    if t_ns.max(initial=0) > _MAX_T_NS:
        raise ValueError(f"its times span {t_ns.max() / 1e9:.3f} s, more than a scan may")
    intensity = np.nan_to_num(_column(table, _INTENSITIES, kept).astype(np.float32))
    return LidarScan(
        stamp_ns=stamp_ns + earliest_ns,
        seq=seq,
        frame=frame,
        points_m=points_m[kept],
        intensity=np.clip(intensity, 0, 255),
        t_ns=t_ns.astype(np.uint32),
        ring=ring.astype(np.uint16),
    )


def _table(cloud: Any) -> NDArray[Any]:
    """The points as records (N,), without the padding at the ends of rows.

    Raises:
        ValueError: see `scan_of`.
    """
    order = ">" if cloud.is_bigendian else "<"
    fields = {field.name: (order + _FORMATS.get(field.datatype, "V1"), field.offset) for field in cloud.fields}
    if missing := [name for name in "xyz" if name not in fields]:
        raise ValueError(f"it has no field {', '.join(missing)}; its fields are {', '.join(fields)}")
    formats, offsets = zip(*fields.values(), strict=True)
    if max(offset + np.dtype(format_).itemsize for format_, offset in fields.values()) > cloud.point_step:
        raise ValueError(f"its fields reach beyond its point_step of {cloud.point_step} bytes")
    row_step = cloud.row_step if cloud.height > 1 else cloud.width * cloud.point_step
    num_bytes = cloud.height * row_step
    if row_step < cloud.width * cloud.point_step or len(cloud.data) < num_bytes:
        size = f"{cloud.height} x {cloud.width} points of {cloud.point_step} bytes in rows of {row_step}"
        raise ValueError(f"its {len(cloud.data)} bytes do not hold {size}")
    dtype = np.dtype({"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": int(cloud.point_step)})
    rows = np.asarray(cloud.data, dtype=np.uint8)[:num_bytes].reshape(cloud.height, row_step)
    return np.ascontiguousarray(rows[:, : cloud.width * cloud.point_step]).reshape(-1).view(dtype)


def _column(table: NDArray[Any], names: tuple[str, ...], rows: NDArray[np.int64]) -> NDArray[Any]:
    """The first of the fields that the table has, or zeros."""
    fields = table.dtype.names or ()
    name = next((name for name in names if name in fields), None)
    return np.zeros(len(rows)) if name is None else table[name][rows]


def _offsets_ns(times: NDArray[Any], stamp_ns: int) -> NDArray[np.int64]:
    """Times of points after the header's stamp: whole numbers are nanoseconds, others seconds; from any beginning.

    Raises:
        ValueError: a time is not finite.
    """
    if not len(times):
        return np.empty(0, dtype=np.int64)
    if not np.isfinite(times).all():
        raise ValueError("the time of a point is not finite")
    if times.dtype.kind == "f" and abs(times[0]) < _MIN_FLOAT_NS:
        seconds = np.floor(times.astype(np.float64))
        offset_ns = seconds.astype(np.int64) * 10**9 + np.round((times - seconds) * 1e9).astype(np.int64)
    else:
        offset_ns = times.astype(np.int64)
    if offset_ns.min() > _ABSOLUTE_NS:
        after_stamp_ns = offset_ns - stamp_ns
        is_of_same_clock = abs(int(after_stamp_ns[0])) < _ABSOLUTE_NS
        return after_stamp_ns if is_of_same_clock else offset_ns - offset_ns.min()
    return offset_ns
