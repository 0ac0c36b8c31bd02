"""What the decoder of Ouster pcaps writes, read from its pipe: see `ouster_child`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray


class FrameError(Exception):
    """The decoder could not go on; the text says why. Empty: the pipe ended without a word."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One measurement: `scan` or `imu`, and its arrays by name."""

    kind: str
    stamp_ns: int
    arrays: dict[str, NDArray[Any]]


def read_frames(stream: IO[bytes]) -> Iterator[Frame]:
    """Every frame up to that which says `end`.

    Raises:
        FrameError: the decoder says why it stopped, or the stream ends before it said `end`.
    """
    while line := stream.readline():
        header = _header(line)
        if header["kind"] == "end":
            return
        if header["kind"] == "error":
            raise FrameError(header["text"])
        arrays = {name: _array(stream, dtype, shape) for name, dtype, shape in header["arrays"]}
        yield Frame(header["kind"], header["stamp_ns"], arrays)
    raise FrameError("")


def _header(line: bytes) -> dict[str, Any]:
    try:
        header: dict[str, Any] = json.loads(line)
    except ValueError as error:
        raise FrameError("") from error
    return header


def _array(stream: IO[bytes], dtype: str, shape: list[int]) -> NDArray[Any]:
    num_bytes = np.dtype(dtype).itemsize * int(np.prod(shape))
    data = stream.read(num_bytes)
    if len(data) != num_bytes:
        raise FrameError("")
    return np.frombuffer(data, dtype).reshape(shape)
