"""Reads PCD files strictly: what the header promises must be there. Nothing is repaired.

Source: https://pointclouds.org/documentation/tutorials/pcd_file_format.html
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Columns = dict[str, NDArray[np.generic]]

_MAX_HEADER_BYTES = 65536
_TYPES = {"F": "f", "U": "u", "I": "i"}
_SIZES = {"F": (4, 8), "U": (1, 2, 4, 8), "I": (1, 2, 4, 8)}
_NUMBERS = ("SIZE", "COUNT", "WIDTH", "HEIGHT", "POINTS")
MAX_TEXT_BYTES = 256 * 1024 * 1024
"""Of the points of a file in words, each of which takes many times its length while it is read."""
MAX_POINT_BYTES = 1024 * 1024 * 1024
"""Of points once they are decompressed."""
_MAX_LZF_RATIO = 100
"""LZF's longest reference is 264 bytes long and takes 3: a block that claims to hold more than this is broken."""


@dataclass(frozen=True, slots=True)
class _Header:
    """fields: name, numpy type and count of each. data: ascii, binary or binary_compressed."""

    fields: tuple[tuple[str, np.dtype[np.generic], int], ...]
    num_points: int
    data: str

    @property
    def num_columns(self) -> int:
        return sum(count for _, _, count in self.fields)

    @property
    def record(self) -> np.dtype[np.void]:
        """One point; fields are numbered, as names may repeat (`_` is padding)."""
        return np.dtype([(f"f{i}", dtype, (count,)) for i, (_, dtype, count) in enumerate(self.fields)])


def parse_pcd(content: bytes) -> Columns:
    """The fields of one value a point, each (N,), by name. Of fields with the same name the first counts.

    Raises:
        ValueError: saying what is wrong with the content.
    """
    lines, body = _split(content)
    header = _parse_header(lines)
    if header.data == "ascii":
        return _from_ascii(header, body)
    if header.data == "binary":
        return _from_binary(header, body)
    return _from_compressed(header, body)


def _split(content: bytes) -> tuple[list[str], bytes]:
    lines: list[str] = []
    start = 0
    while (end := content.find(b"\n", start, _MAX_HEADER_BYTES)) >= 0:
        try:
            line = content[start:end].decode("ascii").strip()
        except UnicodeDecodeError:
            break
        start = end + 1
        if line and not line.startswith("#"):
            lines.append(line)
        if line.startswith("DATA"):
            return lines, content[start:]
    is_pcd = any(line.startswith(("VERSION", "FIELDS")) for line in lines)
    raise ValueError("the header has no DATA line" if is_pcd else "not a PCD file")


def _parse_header(lines: list[str]) -> _Header:
    values = {key: rest for key, *rest in (line.split() for line in lines)}
    for key in ("FIELDS", "SIZE", "TYPE", "WIDTH", "DATA"):
        if not values.get(key):
            raise ValueError(f"the header has no {key}")
    numbers = {key: _counts(key, values[key]) for key in _NUMBERS if key in values}
    num_points = numbers["WIDTH"][0] * numbers.get("HEIGHT", [1])[0]
    if numbers.get("POINTS", [num_points])[0] != num_points:
        raise ValueError(f"POINTS is {numbers['POINTS'][0]}, but WIDTH times HEIGHT is {num_points}")
    data = values["DATA"][0]
    if data not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"DATA is '{data}', must be ascii, binary or binary_compressed")
    names = values["FIELDS"]
    return _Header(_fields(names, values["TYPE"], numbers["SIZE"], numbers.get("COUNT")), num_points, data)


def _counts(key: str, words: list[str]) -> list[int]:
    if not words or not all(word.isdecimal() and len(word) < 19 for word in words):
        raise ValueError(f"{key} is '{' '.join(words)[:40]}', must be whole numbers")
    return [int(word) for word in words]


def _fields(
    names: list[str], types: list[str], sizes: list[int], counts: list[int] | None
) -> tuple[tuple[str, np.dtype[np.generic], int], ...]:
    counts = [1] * len(names) if counts is None else counts
    if not len(names) == len(types) == len(sizes) == len(counts):
        raise ValueError("FIELDS, SIZE, TYPE and COUNT are not of the same length")
    for name, kind, size, count in zip(names, types, sizes, counts, strict=True):
        if size not in _SIZES.get(kind, ()):
            raise ValueError(f"field {name}: there is no type {kind} of {size} bytes")
        if not 1 <= count <= 10_000:
            raise ValueError(f"field {name}: COUNT is {count}")
    rows = zip(names, types, sizes, counts, strict=True)
    return tuple((name, np.dtype(f"<{_TYPES[kind]}{size}"), count) for name, kind, size, count in rows)


def _require(num_points: int, num_present: int) -> None:
    if num_present != num_points:
        reason = "cut off, or the header is wrong" if num_present < num_points else "the header is wrong"
        raise ValueError(f"the header says {num_points} points, the data hold {num_present}: {reason}")


def check_text(body: bytes) -> None:
    """Raises ValueError where the points in words are too many bytes."""
    if len(body) > MAX_TEXT_BYTES:
        raise ValueError(f"its points are {len(body)} bytes of text, at most {MAX_TEXT_BYTES} are read: save as binary")


def _from_ascii(header: _Header, body: bytes) -> Columns:
    check_text(body)
    words = body.split()
    if len(words) % header.num_columns:
        raise ValueError(f"{len(words)} values are no whole number of points of {header.num_columns} values: cut off")
    _require(header.num_points, len(words) // header.num_columns)
    values = numbers_of(words).reshape(-1, header.num_columns)
    columns: Columns = {}
    start = 0
    for name, _, count in header.fields:
        if count == 1:
            columns.setdefault(name, values[:, start])
        start += count
    return columns


def numbers_of(words: list[bytes]) -> NDArray[np.float64]:
    """The numbers that words are, NaN and infinities among them.

    Raises:
        ValueError: a word is no number.
    """
    try:
        return np.array([float(word) for word in words], dtype=np.float64)
    except ValueError as error:
        raise ValueError(f"not a number in the data: {str(error)[:100]}") from error


def _from_binary(header: _Header, body: bytes) -> Columns:
    record = header.record
    _require(header.num_points, len(body) // record.itemsize)
    points = np.frombuffer(body, dtype=record, count=header.num_points)
    columns: Columns = {}
    for i, (name, _, count) in enumerate(header.fields):
        if count == 1:
            columns.setdefault(name, points[f"f{i}"][:, 0])
    return columns


def _from_compressed(header: _Header, body: bytes) -> Columns:
    raw = _decompressed(body, header.num_points * header.record.itemsize)
    columns: Columns = {}
    start = 0
    for name, dtype, count in header.fields:
        if count == 1:
            columns.setdefault(name, np.frombuffer(raw, dtype, header.num_points, start))
        start += dtype.itemsize * count * header.num_points
    return columns


def _decompressed(body: bytes, num_bytes: int) -> bytes:
    """The block that two lengths stand before: of what is stored, and of what it holds."""
    from lzf import decompress

    if num_bytes == 0:
        return b""
    if num_bytes > MAX_POINT_BYTES:
        raise ValueError(f"the header says {num_bytes} bytes of points, at most {MAX_POINT_BYTES} are read")
    if len(body) < 8:
        raise ValueError("the compressed data are cut off")
    stored, held = (int(length) for length in np.frombuffer(body, "<u4", 2))
    if held != num_bytes:
        raise ValueError(f"the header says {num_bytes} bytes of points, the compressed data hold {held}")
    if len(body) - 8 < stored:
        raise ValueError(f"the compressed data are cut off: {len(body) - 8} of {stored} bytes")
    if held > _MAX_LZF_RATIO * stored:
        raise ValueError(f"{stored} compressed bytes cannot hold {held}")
    try:
        raw: bytes | None = decompress(body[8 : 8 + stored], held)
    except ValueError as error:
        raise ValueError(f"the compressed data are broken: {error}") from error
    if raw is None or len(raw) != held:
        raise ValueError("the compressed data are broken")
    return raw
