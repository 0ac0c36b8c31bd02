"""Decodes an Ouster pcap with ouster-sdk: `python ouster_child.py PCAP METADATA`, by an interpreter that has it.

It stands alone: it imports nothing of this project, whose packages that interpreter does not have. It writes frames to
standard output until the pcap or the pipe ends: a line of JSON, then its arrays one after the other as little-endian
bytes in C order. The line has `kind` (scan, imu, error, end), `text` of an error, and of a measurement `stamp_ns` and
`arrays`, a list of [name, dtype, shape].
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

_IS_VALID = 1
"""Bit of a column's status. Source: Ouster sensor data format."""
_MAX_T_NS = 2**32


def main(pcap: str, metadata: str) -> None:
    """Writes every frame of the pcap. The SDK logs to standard output, so that is turned away to standard error."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        for kind, stamp_ns, arrays in decoded(pcap, metadata):
            _write(output, {"kind": kind, "stamp_ns": stamp_ns}, arrays)
        _write(output, {"kind": "end"}, {})
    except BrokenPipeError:
        os._exit(0)  # nobody listens any more: not even for what is left in the buffer
    except (RuntimeError, ValueError, OSError) as error:  # what the SDK raises on files it cannot use
        _write(output, {"kind": "error", "text": " ".join(str(error).split())}, {})


def decoded(pcap: str, metadata: str) -> Iterator[tuple[str, int, dict[str, NDArray[Any]]]]:
    """(kind, stamp_ns, arrays) of each scan and each reading of the IMU, as they are complete.

    Raises:
        ValueError: the metadata are none, or no packet of the pcap is as they say.
        RuntimeError: the SDK cannot read the pcap.
    """
    from ouster.sdk import core
    from ouster.sdk.pcap import PcapPacketSource

    core.init_logger("off")
    info = _read_metadata(core, metadata)
    to_xyz = core.XYZLut(info, use_extrinsics=False)
    batcher, frame = core.FrameBatcher(info), core.LidarFrame(info)
    packets = PcapPacketSource(pcap, sensor_info=[info])
    num_packets = 0
    for _, packet in packets:
        if isinstance(packet, core.ImuPacket) and num_packets:  # not before it is sure that the metadata fit
            yield from _readings(packet, info.imu_to_sensor_transform[:3, :3])
        elif isinstance(packet, core.LidarPacket):
            num_packets += 1
            if batcher.batch(packet, frame):
                yield from _scan(frame, to_xyz)
                frame = core.LidarFrame(info)
    yield from _scan(frame, to_xyz)
    if num_packets == 0:
        of_other = packets.size_error_count + packets.id_error_count
        port = info.config.udp_port_lidar
        raise ValueError(
            f"it has no packet of the sensor in {metadata} on port {port} ({of_other} of another sensor or mode)"
        )


def _read_metadata(core: Any, path: str) -> Any:
    try:
        return core.SensorInfo(Path(path).read_text(encoding="utf-8"))
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"{path} is no metadata of an Ouster: {error}") from error


def _scan(frame: Any, to_xyz: Any) -> Iterator[tuple[str, int, dict[str, NDArray[Any]]]]:
    """The scan of a frame, if it has a column: ranges that returned, ring by ring. Fields are (rings, columns)."""
    columns = np.flatnonzero(frame.status & _IS_VALID)
    if not len(columns):
        return
    stamp_ns = int(frame.timestamp[columns[0]])
    t_ns = frame.timestamp.astype(np.int64) - stamp_ns
    columns = columns[(t_ns[columns] >= 0) & (t_ns[columns] < _MAX_T_NS)]
    ring, column = np.nonzero(frame.field("RANGE")[:, columns])
    column = columns[column]
    yield (
        "scan",
        stamp_ns,
        {
            "points_m": to_xyz(frame)[ring, column].astype("<f4"),
            "intensity": _intensity(frame)[ring, column].astype("<f4"),
            "t_ns": t_ns[column].astype("<u4"),
            "ring": ring.astype("<u2"),
        },
    )


def _intensity(frame: Any) -> NDArray[Any]:
    """Calibrated reflectivity where the sensor gives it, else the strength of the signal; 0..255."""
    name = "REFLECTIVITY" if "REFLECTIVITY" in frame.fields else "SIGNAL"
    values: NDArray[Any] = np.minimum(frame.field(name), 255)
    return values


def _readings(packet: Any, R_sensor_imu: NDArray[np.float64]) -> Iterator[tuple[str, int, dict[str, NDArray[Any]]]]:
    """The readings in a packet of the IMU, along the sensor's axes. The SDK gives rad/s and m/s2."""
    gyro, accel = packet.gyro() @ R_sensor_imu.T, packet.accel() @ R_sensor_imu.T
    for stamp_ns, rate, acceleration in zip(packet.timestamp(), gyro, accel, strict=True):
        arrays = {
            "angular_velocity_radps": rate.astype("<f8"),
            "linear_acceleration_mps2": acceleration.astype("<f8"),
        }
        yield "imu", int(stamp_ns), arrays


def _write(output: IO[bytes], header: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    header["arrays"] = [[name, array.dtype.str, array.shape] for name, array in arrays.items()]
    output.write(json.dumps(header).encode() + b"\n")
    for array in arrays.values():
        output.write(array.tobytes())
    output.flush()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
