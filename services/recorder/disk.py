"""The disk under a recording: files that take every byte or say why not, and the room that is left."""

from __future__ import annotations

import contextlib
import io
import os
from pathlib import Path
from typing import IO, cast

from shared.errors import HyrecroError

BYTES_A_MIB = 1024 * 1024


class RecordingError(HyrecroError):
    """Nothing more can be written; what was written before stays readable."""


class Output:
    """A stream that takes every byte or raises, remembers what is complete, and keeps nothing in this process."""

    def __init__(self, stream: IO[bytes]) -> None:
        self.num_complete_bytes = 0
        self._stream = stream
        self._position = 0

    @property
    def position(self) -> int:
        """Bytes handed to the operating system so far."""
        return self._position

    def write(self, data: bytes | memoryview) -> None:
        """Hands all bytes over.

        Raises:
            OSError: the disk refuses.
        """
        rest = memoryview(data)
        while rest:
            num_taken = self._stream.write(rest)
            self._position += num_taken
            rest = rest[num_taken:]

    def mark_complete(self) -> None:
        """What was written so far is whole: `cut` leaves it."""
        self.num_complete_bytes = self._position

    def cut(self) -> None:
        """Takes away what was begun and not completed, where the stream can."""
        with contextlib.suppress(OSError):
            if self._stream.seekable():
                self._stream.truncate(self.num_complete_bytes)
                self._stream.seek(self.num_complete_bytes)
        self._position = self.num_complete_bytes

    def close(self) -> None:
        """Closes the stream, whatever it says to it."""
        with contextlib.suppress(OSError):
            self._stream.close()


def new_file(path: Path) -> Output:
    """A new file without a buffer in this process.

    Raises:
        RecordingError: it exists already, or cannot be made.
    """
    try:
        return Output(cast("IO[bytes]", io.FileIO(path, "x")))
    except OSError as error:
        raise RecordingError(f"{path}: cannot record into it: {error.strerror}") from error


def free_bytes(folder: Path) -> int:
    """What is left for this user on the disk of a folder, which need not exist yet; 0 if the disk does not say."""
    try:
        disk = os.statvfs(next(place for place in (folder, *folder.absolute().parents) if place.exists()))
    except OSError:
        return 0
    return disk.f_bavail * disk.f_frsize


def check_room(folder: Path, min_free_mib: int, num_bytes: int = 0) -> None:
    """Makes sure that `min_free_mib` are left when `num_bytes` more are written.

    Raises:
        RecordingError: they are not.
    """
    left = free_bytes(folder)
    if left - num_bytes < min_free_mib * BYTES_A_MIB:
        next_text = f" ({num_bytes / BYTES_A_MIB:.1f} MiB were next)" if num_bytes else ""
        raise RecordingError(
            f"{folder}: the disk has {left // BYTES_A_MIB} MiB left, "
            f"recorder.min_free_mib keeps {min_free_mib} free{next_text}"
        )
