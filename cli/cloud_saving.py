"""Saves clouds that come over the bus as data0.pcd, data1.pcd ..., by hand or by itself."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from cli.live_clouds import CloudMessage
from shared.cloud_files import scan_files, write_pcd, write_scan
from shared.errors import InputFileError
from shared.messaging.messages import LidarScan

_POLL_S = 0.1
_SILENCE_S = 5.0


class Stream(Protocol):
    """Where clouds come from; see `cli.live_clouds.CloudStream`."""

    def newest(self, timeout_s: float) -> CloudMessage | None:
        """The newest message that was not taken yet, or None."""


class CloudSaver:
    """Numbers files in a folder on from those that are there: nothing is overwritten."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            is_fresh = not any(folder.glob("data*.pcd"))
        except OSError as error:
            raise InputFileError(f"{folder}: {error.strerror or error}") from error
        self._next = 0 if is_fresh else max(scan_files(folder).paths) + 1

    def save(self, message: CloudMessage) -> Path:
        """Writes a scan with all its fields, another cloud as x y z; returns the new file."""
        path = self._folder / f"data{self._next}.pcd"
        try:
            if isinstance(message, LidarScan):
                write_scan(path, message)
            else:
                write_pcd(path, message.points_m)
        except OSError as error:
            raise InputFileError(f"{path}: {error.strerror or error}") from error
        self._next += 1
        return path


@dataclass(slots=True)
class Every:
    """Asks for a cloud every so many seconds, the first at once."""

    period_s: float
    clock_s: Callable[[], float] = time.monotonic
    _due_s: float = float("-inf")

    def is_due(self) -> bool:
        """Whether the next cloud shall be saved."""
        return self.clock_s() >= self._due_s

    def saved(self) -> None:
        """A cloud was saved; a late one does not shift those after it, but none is made up for."""
        now_s = self.clock_s()
        self._due_s = now_s + self.period_s if now_s - self._due_s > self.period_s else self._due_s + self.period_s


class EnterKey:
    """Asks for a cloud when Enter was pressed in the terminal."""

    def __init__(self) -> None:
        self._is_pressed = False

    def is_due(self) -> bool:
        """Whether Enter was pressed since the last cloud was saved."""
        while select.select([sys.stdin], [], [], 0)[0]:
            if not sys.stdin.readline():
                break
            self._is_pressed = True
        return self._is_pressed

    def saved(self) -> None:
        """A cloud was saved."""
        self._is_pressed = False


def save_clouds(
    stream: Stream,
    saver: CloudSaver,
    trigger: Every | EnterKey,
    num: int | None,
    is_stopping: Callable[[], bool],
    say: Callable[[str], None],
) -> int:
    """Saves what comes when the trigger asks for it, until `num` are saved or `is_stopping`; returns how many."""
    num_saved, heard_s = 0, time.monotonic()
    while not is_stopping() and (num is None or num_saved < num):
        message = stream.newest(_POLL_S)
        if message is None:
            if time.monotonic() - heard_s > _SILENCE_S:
                heard_s = time.monotonic()
                say(f"nothing came for {_SILENCE_S:g} s")
            continue
        heard_s = time.monotonic()
        if trigger.is_due():
            path = saver.save(message)
            trigger.saved()
            num_saved += 1
            say(f"{path}: {len(message.points_m)} points")
    return num_saved
