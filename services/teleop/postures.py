"""Reads named postures: a CSV with header name,q1..q8, radians and metres, one a row."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from shared.errors import InputFileError
from shared.files import read_text
from shared.geometry import Float
from shared.messaging.messages import JOINT_NAMES
from shared.robot.limits import JOINT_UNITS, beyond_limits

_HEADER = ("name", *JOINT_NAMES)


def read_postures(path: Path, lower: Float, upper: Float) -> dict[str, Float]:
    """The postures (8,) of a file by name, in its order; lower, upper: limits (8,) of the joints.

    Raises:
        InputFileError: with file, line and rule, for the first row that is not usable.
    """
    try:
        rows = list(csv.reader(read_text(path).splitlines()))
    except csv.Error as error:
        raise InputFileError(f"{path}: {error}") from error
    if not rows or tuple(cell.strip() for cell in rows[0]) != _HEADER:
        raise InputFileError(f"{path}:1: the header must be {','.join(_HEADER)}")
    postures: dict[str, Float] = {}
    for line, row in enumerate(rows[1:], start=2):
        if any(map(str.strip, row)):
            name, q = _posture(f"{path}:{line}", row)
            if name in postures:
                raise InputFileError(f"{path}:{line}: posture '{name}' is there twice")
            if problems := beyond_limits(JOINT_NAMES, q, lower, upper, JOINT_UNITS):
                raise InputFileError(f"{path}:{line}: posture '{name}': {'; '.join(problems)}")
            postures[name] = q
    if not postures:
        raise InputFileError(f"{path}: there is no posture in it")
    return postures


def _posture(where: str, row: list[str]) -> tuple[str, Float]:
    name, *cells = (cell.strip() for cell in row)
    if not name or len(cells) != len(JOINT_NAMES):
        raise InputFileError(f"{where}: a name and {len(JOINT_NAMES)} values are needed, got {len(cells)} values")
    return name, np.array([_number(where, *pair) for pair in zip(JOINT_NAMES, cells, strict=True)])


def _number(where: str, joint: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputFileError(f"{where}: {joint} is {cell!r}, must be a finite number")
    return value
