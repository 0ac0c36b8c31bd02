"""Reads the original's trajectory files: header q1..q8, a joint target a row, a row of `C` to change the fixed foot."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared.errors import InputFileError
from shared.files import read_text
from shared.messaging.messages import JOINT_NAMES

MAX_ROWS = 100_000


@dataclass(frozen=True, slots=True)
class MoveTo:
    """A target of all joints: (8,) radians, metres for q2 and q7. line: where it stands in the file."""

    q: NDArray[np.float64]
    line: int


@dataclass(frozen=True, slots=True)
class ChangeFoot:
    """The other foot becomes the fixed one."""

    line: int


Trajectory = tuple[MoveTo | ChangeFoot, ...]


def read_trajectory(path: Path) -> Trajectory:
    """The moves of a file, in order.

    Raises:
        InputFileError: with file, line and rule, for the first line that is not usable.
    """
    try:
        lines = csv.reader(read_text(path).splitlines())
        rows = [(number, row) for number, row in enumerate(lines, start=1) if any(map(str.strip, row))]
    except csv.Error as error:
        raise InputFileError(f"{path}: {error}") from error
    if not rows or tuple(cell.strip() for cell in rows[0][1]) != JOINT_NAMES:
        raise InputFileError(f"{path}:1: the header must be {','.join(JOINT_NAMES)}")
    if not 1 < len(rows) <= MAX_ROWS:
        raise InputFileError(f"{path}: has {len(rows) - 1} rows after the header, 1 to {MAX_ROWS} are allowed")
    return tuple(_move(path, line, [cell.strip() for cell in row]) for line, row in rows[1:])


def _move(path: Path, line: int, cells: list[str]) -> MoveTo | ChangeFoot:
    if cells and all(cell == "C" for cell in cells):
        return ChangeFoot(line)
    if len(cells) != len(JOINT_NAMES):
        raise InputFileError(f"{path}:{line}: has {len(cells)} values, {len(JOINT_NAMES)} are needed")
    return MoveTo(np.array([_number(path, line, *pair) for pair in zip(JOINT_NAMES, cells, strict=True)]), line)


def _number(path: Path, line: int, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputFileError(f"{path}:{line}: {name} is {cell!r}, must be a finite number (or a row of C)")
    return value
