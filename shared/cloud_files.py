"""Point clouds as files: PCD, PLY, LAS by suffix; and the scans of a folder."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shared.errors import CloudFileError, InputFileError
from shared.files import BYTES_A_MIB, read_bytes
from shared.las_format import las_bytes, parse_las
from shared.messaging.messages import LidarScan
from shared.pcd_format import Columns, parse_pcd
from shared.ply_format import parse_ply, ply_bytes

Colours = NDArray[np.uint8]
T = TypeVar("T")

MAX_FILE_BYTES = 1024 * BYTES_A_MIB
"""Some 60 million points of x, y, z and intensity."""

_PARSERS: dict[str, Callable[[bytes], Columns]] = {".pcd": parse_pcd, ".ply": parse_ply, ".las": parse_las}
_FAR_M = 500.0
"""Beyond the range of any LiDAR for lattices; a scan in millimetres has its points there from 0.5 m on."""
_MAX_WHOLE = 2.0**53
_SCAN_NAME = re.compile(r"data(\d{1,9})\.pcd")


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points (N, 3) float64 in the file's frame, NaN where the file has it; None for what the file does not state.

    intensity (N,) as stored. t_ns (N,): after the scan's begin, from an integer field `t`. ring (N,): 0 = top.
    """

    points_m: NDArray[np.float64]
    intensity: NDArray[np.float64] | None = None
    t_ns: NDArray[np.int64] | None = None
    ring: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True)
class ScanFiles:
    """paths: by their number, in its order. missing: names of files, or runs of them, that the numbering leaves out."""

    paths: dict[int, Path]
    missing: tuple[str, ...]

    def first(self, num: int | None) -> ScanFiles:
        """The first so many; None: all."""
        numbers = list(self.paths)[:num]
        return ScanFiles({number: self.paths[number] for number in numbers}, _gaps(numbers))


def read_cloud(path: Path) -> Cloud:
    """The cloud of a .pcd, .ply or .las file. No points, and points that are NaN, are legal.

    Raises:
        InputFileError: there is no such file, its suffix is unknown, or it is larger than `MAX_FILE_BYTES`.
        CloudFileError: its content is not what its format and header promise.
    """
    parse = _by_suffix(_PARSERS, path, "read from")
    content = read_bytes(path, MAX_FILE_BYTES)
    try:
        return _cloud(parse(content))
    except ValueError as error:
        raise CloudFileError(f"{path}: {error}") from error


def check_writable(path: Path) -> None:
    """Tells before the work that a cloud cannot be written there.

    Raises:
        InputFileError: the suffix is unknown, or there is no such folder.
    """
    _by_suffix(_WRITERS, path, "written as")
    if not path.parent.is_dir():
        raise InputFileError(f"{path}: there is no folder {path.parent}")


def write_cloud(path: Path, points_m: NDArray[np.floating], colours: Colours | None = None) -> None:
    """Writes points (N, 3), with colours (N, 3) red green blue where given, as .pcd (float32), .ply or .las.

    Raises:
        InputFileError: the suffix is unknown, the file cannot be written, or its format cannot hold the points.
    """
    write = _by_suffix(_WRITERS, path, "written as")
    try:
        write(path, points_m, colours)
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror or error}") from error


def write_pcd(path: Path, points_m: NDArray[np.floating], colours: Colours | None = None) -> None:
    """Points (N, 3) as a binary PCD of float32 x y z, with colours (N, 3) as PCL packs them: `rgb`."""
    from pypcd4 import Encoding, PointCloud

    if colours is None:
        PointCloud.from_xyz_points(points_m.astype(np.float32)).save(path, encoding=Encoding.BINARY)
        return
    red, green, blue = colours.astype(np.uint32).T
    packed = ((red << 16) | (green << 8) | blue).astype(np.uint32).view(np.float32)
    columns = [*points_m.astype(np.float32).T, packed]
    PointCloud.from_points(columns, ("x", "y", "z", "rgb"), (np.float32,) * 4).save(path, encoding=Encoding.BINARY)


def write_scan(path: Path, scan: LidarScan) -> None:
    """A scan as a binary PCD with the fields that LiDAR users know: x y z intensity t (ns in the scan) ring."""
    from pypcd4 import Encoding, PointCloud

    columns = [*scan.points_m.T, scan.intensity, scan.t_ns, scan.ring]
    fields = ("x", "y", "z", "intensity", "t", "ring")
    types = (np.float32, np.float32, np.float32, np.float32, np.uint32, np.uint16)
    PointCloud.from_points(columns, fields, types).save(path, encoding=Encoding.BINARY)


def scan_files(folder: Path) -> ScanFiles:
    """The files data0.pcd, data1.pcd ... of a folder, in the order of their numbers.

    Raises:
        InputFileError: there is no such folder, it has no such file, or two of the same number.
    """
    try:
        found = sorted(entry for entry in folder.iterdir() if _SCAN_NAME.fullmatch(entry.name))
    except OSError as error:
        raise InputFileError(f"{folder}: {error.strerror or error}") from error
    if not found:
        raise InputFileError(f"{folder}: has no files data0.pcd, data1.pcd, ...")
    paths: dict[int, Path] = {}
    for path in found:
        number = int(path.stem.removeprefix("data"))
        if number in paths:
            raise InputFileError(f"{folder}: {paths[number].name} and {path.name} have the same number")
        paths[number] = path
    numbers = sorted(paths)
    return ScanFiles({number: paths[number] for number in numbers}, _gaps(numbers))


def unit_warning(points_m: NDArray[np.floating]) -> str | None:
    """What to tell the user where coordinates look like millimetres: far from the origin and far apart; else None."""
    finite = points_m[np.isfinite(points_m).all(axis=1)]
    if len(finite) == 0:
        return None
    median_m = float(np.median(np.linalg.norm(finite, axis=1)))
    low, high = np.percentile(finite, [5, 95], axis=0)
    if median_m <= _FAR_M or float((high - low).max()) <= _FAR_M:
        return None
    return f"the median point is {median_m:.0f} m away: are the coordinates in millimetres? They must be in metres"


def _gaps(numbers: list[int]) -> tuple[str, ...]:
    gaps: list[str] = []
    for before, after in zip([-1, *numbers], numbers, strict=False):
        first, last = f"data{before + 1}.pcd", f"data{after - 1}.pcd"
        if after - before > 1:
            gaps.append(first if first == last else f"{first} to {last}")
    return tuple(gaps)


def _cloud(columns: Columns) -> Cloud:
    if lacking := [name for name in "xyz" if name not in columns]:
        raise ValueError(f"it has no field {', '.join(lacking)}; its fields are {', '.join(columns) or 'none'}")
    points_m = np.column_stack([columns[name].astype(np.float64) for name in "xyz"])
    intensity = columns.get("intensity")
    return Cloud(
        points_m,
        None if intensity is None else intensity.astype(np.float64),
        _integers(columns.get("t")),
        _integers(columns.get("ring")),
    )


def _integers(column: NDArray[np.generic] | None) -> NDArray[np.int64] | None:
    """A column of whole numbers; None for one that is not: a `t` in seconds is not what we call t."""
    if column is None or not (np.abs(column.astype(np.float64)) < _MAX_WHOLE).all():
        return None
    whole = column.astype(np.int64)
    return whole if bool((whole == column).all()) else None


def _write_ply(path: Path, points_m: NDArray[np.floating], colours: Colours | None) -> None:
    path.write_bytes(ply_bytes(points_m, colours))


def _write_las(path: Path, points_m: NDArray[np.floating], colours: Colours | None) -> None:
    path.write_bytes(las_bytes(points_m, colours))


Writer = Callable[[Path, NDArray[np.floating], Colours | None], None]
_WRITERS: dict[str, Writer] = {".pcd": write_pcd, ".ply": _write_ply, ".las": _write_las}


def _by_suffix(table: dict[str, T], path: Path, verb: str) -> T:
    found = table.get(path.suffix.lower())
    if found is None:
        raise InputFileError(f"{path}: clouds are {verb} {', '.join(table)}, not '{path.suffix}'")
    return found
