"""Trajectories in the TUM format: `t x y z qx qy qz qw` a line, seconds and metres, `#` before comments.

Source: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
"""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal, InvalidOperation
from pathlib import Path

from shared.errors import TrajectoryFileError
from shared.files import read_text
from shared.geometry import SE3

_MAX_STAMP_S = 9_000_000_000
"""Integer nanoseconds of 64 bits end soon after."""


def read_tum(path: Path) -> list[tuple[int, SE3]]:
    """Stamped poses, at least one, in the order of their stamps.

    Raises:
        InputFileError: the file cannot be read.
        TrajectoryFileError: naming file, line and rule: eight finite numbers, a quaternion of length 1 within 1e-3,
            stamps that increase and are not negative.
    """
    poses: list[tuple[int, SE3]] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        try:
            stamp_ns, pose = _parse(words)
            if poses and stamp_ns <= poses[-1][0]:
                raise ValueError(f"stamp {words[0]} does not come after the one before it")
        except ValueError as error:
            raise TrajectoryFileError(f"{path}: line {number}: {error}") from error
        poses.append((stamp_ns, pose))
    if not poses:
        raise TrajectoryFileError(f"{path}: holds no poses")
    return poses


def write_tum(path: Path, poses: Iterable[tuple[int, SE3]]) -> None:
    """Stamped poses in the TUM format, `t x y z qx qy qz qw`, seconds and metres at full precision."""
    with path.open("w", encoding="ascii") as file:
        for stamp_ns, pose in poses:
            values = " ".join(repr(float(value)) for value in pose.xyz_quat_xyzw)
            file.write(f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d} {values}\n")


def _parse(words: list[str]) -> tuple[int, SE3]:
    if len(words) != 8:
        raise ValueError(f"{len(words)} values, must be 8: t x y z qx qy qz qw")
    try:
        stamp_s, values = Decimal(words[0]), [float(word) for word in words[1:]]
    except (InvalidOperation, ValueError) as error:
        raise ValueError(f"'{' '.join(words)[:80]}' are not eight numbers") from error
    if not stamp_s.is_finite() or not 0 <= stamp_s <= _MAX_STAMP_S:
        raise ValueError(f"stamp {words[0]} must be within 0 .. {_MAX_STAMP_S} seconds")
    return round(stamp_s * 10**9), SE3.from_xyz_quat_xyzw(values)
