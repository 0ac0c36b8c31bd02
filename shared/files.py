"""Files as texts and as bytes. Clouds are in `shared.cloud_files`, trajectories in `shared.trajectory_files`."""

from __future__ import annotations

from pathlib import Path

from shared.errors import InputFileError

BYTES_A_MIB = 1024 * 1024
MAX_TEXT_BYTES = 64 * BYTES_A_MIB
"""Of structures, tables, trajectories: the largest lattice that can be made has 20 MB."""


def read_text(path: Path, max_bytes: int = MAX_TEXT_BYTES) -> str:
    """The text of a file, without the mark of UTF-8 that some editors put before it.

    Raises:
        InputFileError: it cannot be read, is larger than `max_bytes`, or is not UTF-8.
    """
    try:
        return read_bytes(path, max_bytes).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise InputFileError(f"{path}: not UTF-8 text: {error.reason} at byte {error.start}") from error


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """The bytes of a file.

    Raises:
        InputFileError: it cannot be read or is larger than `max_bytes`; no more than that is ever taken.
    """
    try:
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise InputFileError(f"{path}: {reason}") from error
    if len(content) > max_bytes:
        raise InputFileError(f"{path}: is {_size_of(path, len(content))}, at most {mib_text(max_bytes)} are read")
    return content


def mib_text(num_bytes: int) -> str:
    """A size for people: 3.2 MiB."""
    return f"{num_bytes / BYTES_A_MIB:.4g} MiB"


def _size_of(path: Path, num_read: int) -> str:
    num_bytes = path.stat().st_size
    return mib_text(num_bytes) if num_bytes >= num_read else f"more than {mib_text(num_read - 1)}"
