"""Tables of beams as files: the project's own YAML, and the metadata JSON of a real Ouster sensor."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.sensors.lidar.beams import Beams
from shared.errors import InputFileError
from shared.files import read_text
from shared.geometry import SE3
from shared.yaml_reading import YamlError, load_yaml

NUM_BEAMS = 128
"""An OS1-128 has as many."""
_MM = 1e-3


def read_beams(path: Path, num_columns: int) -> Beams:
    """The beams of a table (see configs/sensors/beams/), or of an Ouster's metadata where the file ends in .json.

    Raises:
        InputFileError: naming file, key and rule.
    """
    table = _from_ouster(path) if path.suffix == ".json" else _parsed_yaml(path)
    elevations_deg = _numbers(path, table, "elevations_deg", NUM_BEAMS)
    if (np.diff(elevations_deg) >= 0).any() or np.abs(elevations_deg).max() >= 90:
        raise InputFileError(f"{path}: elevations_deg: must fall from top to bottom, within -90..90")
    (origin_m,) = _numbers(path, table, "origin_m", 1)
    if not 0 <= origin_m < 0.1:
        raise InputFileError(f"{path}: origin_m: must be within 0..0.1, is {origin_m:g}")
    rpy_rad = np.deg2rad(_numbers(path, table, "sensor_lidar_rpy_deg", 3))
    return Beams(
        elevation_rad=np.deg2rad(elevations_deg),
        azimuth_rad=-np.deg2rad(_numbers(path, table, "azimuths_deg", NUM_BEAMS)),
        origin_m=float(origin_m),
        T_sensor_lidar=SE3.from_rpy(rpy_rad, _numbers(path, table, "sensor_lidar_xyz_m", 3)),
        num_columns=num_columns,
    )


def _parsed_yaml(path: Path) -> Mapping[str, Any]:
    try:
        table = load_yaml(read_text(path), str(path))
    except YamlError as error:
        raise InputFileError(str(error)) from error
    if not isinstance(table, dict):
        raise InputFileError(f"{path}: must be a table of beams, is {type(table).__name__}")
    return table


def _from_ouster(path: Path) -> Mapping[str, Any]:
    """The same table from a sensor's metadata, of the old flat form or the newer one in sections.

    Source: Ouster sensor documentation, `get_sensor_info`; lengths are millimetres.
    """
    try:
        metadata = json.loads(read_text(path))
    except ValueError as error:
        raise InputFileError(f"{path}: not valid JSON: {error}") from error
    if not isinstance(metadata, dict):
        raise InputFileError(f"{path}: must be an Ouster's metadata, is {type(metadata).__name__}")
    known = {**metadata, **metadata.get("beam_intrinsics", {}), **metadata.get("lidar_intrinsics", {})}
    T_sensor_lidar = _numbers(path, known, "lidar_to_sensor_transform", 16).reshape(4, 4)
    return {
        "elevations_deg": known.get("beam_altitude_angles"),
        "azimuths_deg": known.get("beam_azimuth_angles"),
        "origin_m": _MM * float(_numbers(path, known, "lidar_origin_to_beam_origin_mm", 1)[0]),
        "sensor_lidar_xyz_m": list(_MM * T_sensor_lidar[:3, 3]),
        "sensor_lidar_rpy_deg": list(np.rad2deg(SE3.projected(T_sensor_lidar).rpy_rad)),
    }


def _numbers(path: Path, table: Mapping[str, Any], key: str, count: int) -> NDArray[np.float64]:
    value = table.get(key)
    values = value if isinstance(value, list) else [value]
    if not all(isinstance(each, int | float) and not isinstance(each, bool) for each in values):
        raise InputFileError(f"{path}: {key}: must be {count} number{'s' * (count > 1)}")
    if len(values) != count:
        raise InputFileError(f"{path}: {key}: must be {count} number{'s' * (count > 1)}, are {len(values)}")
    numbers = np.array(values, dtype=np.float64)
    if not np.isfinite(numbers).all():
        raise InputFileError(f"{path}: {key}: must be finite")
    return numbers
