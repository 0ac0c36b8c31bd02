"""Recordings of ROS: their topics, and the messages of some of them one by one."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Generator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.highlevel.anyreader import ReaderErrors
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_typestore
from rosbags.typesys.store import Typestore

from shared.errors import InputFileError
from shared.mcap_chunks import BROKEN

RosMessages = Generator[tuple[str, Any], None, str]
"""(topic, ROS message) of each; returns how the recording ended if not as it should, else an empty text."""

_UNREADABLE = (
    *BROKEN,
    *ReaderErrors,
    AnyReaderError,
    AssertionError,
    OSError,
    SerdeError,
    TypesysError,
    sqlite3.Error,
)
"""What the libraries raise on bytes that are not what they should be."""


class Bag(Protocol):
    """A recording on disk. Both methods raise InputFileError where it cannot be read."""

    def topics(self) -> dict[str, str]:
        """Topic -> ROS type."""

    def messages(self, topics: Collection[str]) -> RosMessages:
        """The messages of these topics, in their order in the recording."""


class Rosbag:
    """What rosbags reads: a rosbag2 folder, a `.db3` file of one, a ROS 1 bag."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def topics(self) -> dict[str, str]:
        """Topic -> ROS type."""
        with readable(self._path), self._reader() as reader:
            return {connection.topic: connection.msgtype for connection in reader.connections}

    def messages(self, topics: Collection[str]) -> RosMessages:
        """The messages of these topics, in the order in which they were received."""
        with readable(self._path), self._reader() as reader:
            wanted = [connection for connection in reader.connections if connection.topic in topics]
            for connection, _, data in reader.messages(wanted):
                yield connection.topic, reader.deserialize(data, connection.msgtype)
        return ""

    def _reader(self) -> AnyReader:
        return AnyReader([self._path], default_typestore=ros2_types())


@contextmanager
def readable(path: Path) -> Generator[None, None, None]:
    """Whatever the libraries say about a file becomes one clear error.

    Raises:
        InputFileError: naming the file.
    """
    try:
        yield
    except _UNREADABLE as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputFileError(f"{path}: not readable as a recording: {reason}") from error


@cache
def ros2_types() -> Typestore:
    """The message types of ROS 2; those of sensors are the same in all its releases."""
    return get_typestore(Stores.ROS2_JAZZY)
