"""Gives out the messages of a recording at the pace at which they were measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from services.sensors.sources.interface import Recording
from shared.errors import InputFileError
from shared.messaging.messages import (
    CameraInfo,
    DepthImage,
    Event,
    Imu,
    LidarScan,
    Measurement,
    Message,
    Severity,
)

_MAX_A_CALL = 8
"""So that a recording that is read more slowly than it was made leaves its process time for all else."""
_PATIENCE_NS = 3 * 10**9
_NOUNS: dict[type[Message], str] = {
    LidarScan: "scans",
    DepthImage: "images",
    CameraInfo: "camera infos",
    Imu: "IMU readings",
}


class SourcePlayback:
    """Plays a recording once. It has no clock: it is told the time, in nanoseconds from anywhere.

    name: of the recording, for people. source: of the events. recording: see `Recording`.
    preface: makes a message, of the first stamp, that goes ahead of all.
    A message older than the last one of its type is dropped and counted.

    Raises:
        InputFileError: there is nothing to play.
    """

    def __init__(
        self, name: str, source: str, recording: Recording, preface: Callable[[int], Message] | None = None
    ) -> None:
        self._name, self._source, self._recording = name, source, recording
        self._ending = ""
        self._next = self._read()
        if self._next is None:
            ending = f", {self._ending}" if self._ending else ""
            raise InputFileError(f"{name}: it has no message to play{ending}")
        self._first_stamp_ns = self._stamp_ns = self._next.stamp_ns
        self._preface = [preface(self._stamp_ns)] if preface else []
        self._asked_ns: int | None = None
        self._start_ns: int | None = None
        self._last_stamps_ns: dict[type[Message], int] = {}
        self._num_sent: Counter[type[Message]] = Counter()
        self._going_back: set[type[Message]] = set()
        self.num_dropped = 0
        self.is_done = False

    def due(self, now_ns: int, *, is_wanted: bool = True) -> list[Message]:
        """What is due by now, some at a time. At the end an event says so.

        is_wanted: whether anybody listens. It starts with the first call at which somebody does, or some seconds after
        the first call: what is sent before others are known to listen is lost to them.

        Raises:
            InputFileError: the recording has something that cannot be used.
        """
        self._asked_ns = now_ns if self._asked_ns is None else self._asked_ns
        if self._start_ns is None:
            if not is_wanted and now_ns - self._asked_ns < _PATIENCE_NS:
                return []
            self._start_ns = now_ns
        messages, self._preface = self._preface, []
        for _ in range(_MAX_A_CALL):
            if self._next is None:
                return [*messages, *self._end()]
            self._stamp_ns = max(self._stamp_ns, self._next.stamp_ns)
            if self._stamp_ns - self._first_stamp_ns > now_ns - self._start_ns:
                return messages
            messages += self._checked(self._next)
            self._next = self._read()
        return messages

    def close(self) -> list[Message]:
        """Lets go of the recording. Idempotent."""
        self._recording.close()
        return []

    def _read(self) -> Measurement | None:
        try:
            return next(self._recording)
        except StopIteration as end:
            self._ending = end.value or ""
            return None

    def _checked(self, message: Measurement) -> list[Message]:
        kind = type(message)
        late_ns = self._last_stamps_ns.get(kind, 0) - message.stamp_ns
        if late_ns <= 0:
            self._last_stamps_ns[kind] = message.stamp_ns
            self._num_sent[kind] += 1
            self._going_back.discard(kind)
            return [message]
        self.num_dropped += 1
        if kind in self._going_back:
            return []
        self._going_back.add(kind)
        noun = _NOUNS.get(kind, "messages")
        text = f"{self._name}: time goes back by {late_ns / 1e9:.3f} s: {noun} are dropped until it has caught up"
        return [self._event(Severity.ERROR, text)]

    def _end(self) -> list[Message]:
        if self.is_done:
            return []
        self.is_done = True
        counts = [f"{self._num_sent[kind]} {noun}" for kind, noun in _NOUNS.items() if kind in self._num_sent]
        dropped = [f"{self.num_dropped} dropped"] if self.num_dropped else []
        ending = [self._ending] if self._ending else []
        text = f"end of {self._name}: {', '.join([*counts, *dropped, *ending])}"
        return [self._event(Severity.WARNING if ending else Severity.INFO, text)]

    def _event(self, severity: Severity, text: str) -> Event:
        return Event(stamp_ns=self._stamp_ns, seq=0, frame="", source=self._source, severity=severity, text=text)
