"""What a service must know again after it was killed, in files: each is whole or absent, and checked when read.

A file is MAGIC, the CRC-32 of the rest, then a MessagePack map: whose it is, under which settings, and the state as the
codec packs messages. It is renamed into place, so a death while it is written leaves the one before. Nothing is synced
to a disk: a process that dies is survived, a machine that does is not.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import struct
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import msgpack

from shared.errors import CodecError, InputFileError, SnapshotError
from shared.messaging.codec import decode, encode, schema_of
from shared.messaging.messages import Message
from shared.runtime.config import Config

S = TypeVar("S", bound=Message)

MAGIC = b"HYRECRO1"
_HEAD = struct.Struct("<8sI")
_MEMORY = Path("/dev/shm")  # noqa: S108 - where it is not writable, the system's folder for such things is taken
_PREFIX = "hyrecro-state-"
_OF_NO_STATE = {"bus", "recorder", "player", "teleop", "state_directory"}
"""Settings that may differ between two starts of a service that goes on."""


class Snapshots:
    """The snapshots of one service, `FOLDER/SERVICE.PART`. settings: those that a state belongs to."""

    def __init__(self, folder: Path, service: str, settings: str) -> None:
        self._folder, self._service, self._settings = folder, service, settings

    def write(self, part: str, state: Message) -> None:
        """Replaces the last snapshot of a part.

        Raises:
            SnapshotError: the folder cannot be written to.
        """
        body = msgpack.packb([self._service, self._settings, schema_of(type(state)), encode(state)])
        path = self._path(part)
        fresh = f"{path}.new"
        try:
            with open(fresh, "wb", buffering=0) as file:
                file.write(b"".join((_HEAD.pack(MAGIC, zlib.crc32(body)), body)))
            os.rename(fresh, path)
        except OSError as error:
            raise SnapshotError(f"{path}: {error.strerror or error}") from error

    def read(self, part: str, kind: type[S]) -> S | None:
        """The last snapshot of a part; None where there is none.

        Raises:
            SnapshotError: it is damaged, of another service, version or configuration, or cannot be read.
        """
        path = self._path(part)
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise SnapshotError(f"{path}: {error.strerror or error}") from error
        service, settings, schema, payload = _unpacked(path, data)
        if service != self._service:
            raise SnapshotError(f"{path}: is of the service {service}")
        if settings != self._settings:
            raise SnapshotError(f"{path}: was made with another configuration")
        try:
            return decode(kind, payload, schema=schema)
        except CodecError as error:
            raise SnapshotError(f"{path}: {error}") from error

    def _path(self, part: str) -> Path:
        return self._folder / f"{self._service}.{part}"


def settings_of(config: Config) -> str:
    """What tells the settings that a state belongs to from others: a hash of them."""
    return hashlib.sha256(config.model_dump_json(exclude=_OF_NO_STATE).encode()).hexdigest()[:16]


@contextmanager
def state_folder(chosen: Path | None) -> Iterator[Path]:
    """A folder for the state of one run: the chosen one, which stays, or one in memory, which is gone afterwards.

    What launchers left there that were killed is removed, too: who lives holds a lock in its folder.

    Raises:
        InputFileError: the chosen folder cannot be made.
    """
    if chosen is not None:
        try:
            chosen.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputFileError(f"state_directory {chosen}: {error.strerror or error}") from error
        yield chosen
        return
    place = _MEMORY if os.access(_MEMORY, os.W_OK) else Path(tempfile.gettempdir())
    for left in place.glob(f"{_PREFIX}*"):
        _remove_if_abandoned(left)
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=place))
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _remove_if_abandoned(folder: Path) -> None:
    with suppress(OSError), (folder / "lock").open("r") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder, ignore_errors=True)


def _unpacked(path: Path, data: bytes) -> tuple[str, str, str, bytes]:
    """service, settings, schema, payload."""
    if len(data) < _HEAD.size or not data.startswith(MAGIC):
        raise SnapshotError(f"{path}: is no snapshot of this version")
    body = memoryview(data)[_HEAD.size :]
    if zlib.crc32(body) != _HEAD.unpack_from(data)[1]:
        raise SnapshotError(f"{path}: is damaged: its checksum is another")
    try:
        fields: Any = msgpack.unpackb(body)
        service, settings, schema, payload = fields
    except (ValueError, TypeError, msgpack.exceptions.UnpackException) as error:
        raise SnapshotError(f"{path}: is no snapshot of this version") from error
    return service, settings, schema, payload
