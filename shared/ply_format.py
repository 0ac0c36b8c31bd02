"""The points of PLY files: the element `vertex`; faces and other elements behind it are left alone.

Source: http://paulbourke.net/dataformats/ply/
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from shared.pcd_format import Columns, check_text, numbers_of

_MAX_HEADER_BYTES = 65536
_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(slots=True)
class _Element:
    """properties: name and numpy type of each, without byte order; None for a list."""

    name: str
    num_rows: int
    properties: list[tuple[str, str | None]] = field(default_factory=list)

    def record(self, order: str) -> np.dtype[np.void]:
        """One row in the file.

        Raises:
            ValueError: it has a list, so rows differ in length.
        """
        if any(kind is None for _, kind in self.properties):
            raise ValueError(f"element {self.name} has a list: only behind the vertices can it be left alone")
        return np.dtype([(name, f"{order}{kind}") for name, kind in self.properties])


def parse_ply(content: bytes) -> Columns:
    """The properties of the vertices, each (N,), by name.

    Raises:
        ValueError: saying what is wrong with the content.
    """
    lines, body = _split(content)
    order, elements = _parse_header(lines)
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise ValueError("it has no vertices")
    until = names.index("vertex") + 1
    return _from_ascii(elements[:until], body) if not order else _from_binary(elements[:until], order, body)


def _split(content: bytes) -> tuple[list[str], bytes]:
    if not content.startswith((b"ply\n", b"ply\r\n")):
        raise ValueError("not a PLY file")
    end = content.find(b"end_header", 0, _MAX_HEADER_BYTES)
    newline = content.find(b"\n", end)
    if end < 0 or newline < 0:
        raise ValueError("the header has no end_header")
    return content[:end].decode("ascii", errors="replace").splitlines()[1:], content[newline + 1 :]


def _parse_header(lines: list[str]) -> tuple[str, list[_Element]]:
    order: str | None = None
    elements: list[_Element] = []
    for line in lines:
        match line.split():
            case ["format", name, "1.0"] if name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append(_Element(name, int(count)))
            case ["property", "list", _, _, name] if elements:
                elements[-1].properties.append((name, None))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append((name, _TYPES[kind]))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"header line '{line.strip()[:60]}' is not understood")
    if order is None:
        raise ValueError("the header has no format")
    return order, elements


def _from_binary(elements: list[_Element], order: str, body: bytes) -> Columns:
    start = 0
    for element in elements[:-1]:
        start += element.num_rows * element.record(order).itemsize
    vertices, record = elements[-1], elements[-1].record(order)
    num_present = max(len(body) - start, 0) // max(record.itemsize, 1)
    _require(vertices.num_rows, num_present)
    rows = np.frombuffer(body, dtype=record, count=vertices.num_rows, offset=start if vertices.num_rows else 0)
    return {name: rows[name] for name in record.names or ()}


def _from_ascii(elements: list[_Element], body: bytes) -> Columns:
    check_text(body)
    lines = [line for line in body.splitlines() if line.strip()]
    start = sum(element.num_rows for element in elements[:-1])
    vertices = elements[-1]
    _require(vertices.num_rows, max(len(lines) - start, 0))
    names = list(vertices.record("<").names or ())
    words = [line.split() for line in lines[start : start + vertices.num_rows]]
    for number, row in enumerate(words):
        if len(row) != len(names):
            raise ValueError(f"vertex {number} has {len(row)} values, must be {len(names)}: cut off")
    values = numbers_of([word for row in words for word in row]).reshape(-1, len(names))
    return {name: values[:, i] for i, name in enumerate(names)}


def _require(num_points: int, num_present: int) -> None:
    if num_present < num_points:
        raise ValueError(f"the header says {num_points} vertices, the data hold {num_present}: cut off")


def ply_bytes(points_m: NDArray[np.floating], colours: NDArray[np.uint8] | None = None) -> bytes:
    """Points (N, 3) as a binary PLY of float64 x y z, with colours (N, 3) red green blue where given."""
    kinds = [(name, "<f8") for name in "xyz"]
    kinds += [(name, "u1") for name in ("red", "green", "blue")] if colours is not None else []
    rows = np.empty(len(points_m), dtype=np.dtype(kinds))
    for i, name in enumerate("xyz"):
        rows[name] = points_m[:, i]
    for i, name in enumerate(("red", "green", "blue") if colours is not None else ()):
        rows[name] = colours[:, i]  # type: ignore[index]
    properties = "".join(f"property {'double' if kind == '<f8' else 'uchar'} {name}\n" for name, kind in kinds)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{properties}end_header\n"
    return header.encode() + rows.tobytes()
