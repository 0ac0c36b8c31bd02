"""Gives out the messages of a recording when they are due: at a pace, from and to a time, as often as wanted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from services.recorder.bag.recorded import Recorded, UnreadableError
from services.recorder.replay.lockstep import Lockstep
from shared.errors import RefusedError
from shared.messaging.channels import Channel
from shared.messaging.messages import Clock, MapStatus, Message, ReplayAction, ReplayControl
from shared.runtime.node import Addressed

_MAX_A_CALL = 64
"""So that commands are heard in between."""
_STEP_NS = 100_000_000
"""A step of a paused replay: a revolution of the LiDAR."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """How a recording is replayed.

    first_ns, last_ns: stamps of the recording's first and last message. start_ns, end_ns: of the part that is wanted,
    as stamps. speed: recorded seconds a second; None: as fast as it can. channels: recorded channel -> where it goes.
    """

    first_ns: int
    last_ns: int
    start_ns: int
    end_ns: int
    channels: Mapping[Channel, Channel]
    speed: float | None = 1.0
    is_looping: bool = False
    is_paused: bool = False


class Replay:
    """The facade. It has no clock: it is told the time, in nanoseconds from anywhere.

    Messages keep the order in which they were recorded, so what was computed from a scan comes after it, though it has
    the scan's stamp; each is due with the newest stamp before it. They keep their stamps and numbers.

    open_: begins to read the recording anew; it gives the messages of the channels that are wanted. lockstep: what
    holds back scans until a mapper has answered. unreadable: what could not be decoded so far.
    """

    def __init__(
        self, options: ReplayOptions, open_: Callable[[], Iterator[Recorded]], lockstep: Lockstep | None = None
    ) -> None:
        self._options, self._open, self._lockstep = options, open_, lockstep
        self._speed = options.speed
        self._is_paused = options.is_paused
        self._anchor: tuple[int, int] | None = None
        self._kept: list[Recorded] = []
        self._messages: Iterator[Recorded] = iter(())
        self._next: Recorded | None = None
        self._due_ns = self._position_ns = self._pause_ns = options.start_ns
        self.num_sent = 0
        self.unreadable: list[str] = []
        self._seek(options.start_ns)

    @property
    def progress(self) -> float:
        """Share of the wanted part that has been given out, 0..1."""
        options = self._options
        share = (self._position_ns - options.start_ns) / max(options.end_ns - options.start_ns, 1)
        return 1.0 if self.is_done else min(max(share, 0.0), 1.0)

    @property
    def position_s(self) -> float:
        """Seconds after the recording's first message."""
        return (self._position_ns - self._options.first_ns) / 1e9

    @property
    def is_paused(self) -> bool:
        """Whether it waits for a command."""
        return self._is_paused

    @property
    def is_done(self) -> bool:
        """Whether all has been given out, and in lockstep answered."""
        return self._is_over and not self._options.is_looping

    def due(self, now_ns: int) -> list[Addressed]:
        """What is due by now, some at a time.

        Raises:
            ReplayError: in lockstep no mapper answers.
        """
        if self._lockstep is not None:
            self._lockstep.check(now_ns)
        if self._is_over and self._options.is_looping:
            self._seek(self._options.start_ns)
        until_ns = self._until_ns(now_ns)
        said: list[Addressed] = []
        while len(said) < _MAX_A_CALL and (recorded := self._take(until_ns, now_ns)) is not None:
            said += self._sent(recorded)
        return said

    def control(self, wanted: ReplayControl) -> list[Message]:
        """Carries out a command.

        Raises:
            RefusedError: a time after the recording's end.
        """
        if wanted.seek_s is not None:
            stamp_ns = self._options.first_ns + round(wanted.seek_s * 1e9)
            if stamp_ns > self._options.last_ns:
                length_s = (self._options.last_ns - self._options.first_ns) / 1e9
                raise RefusedError(f"seek_s is {wanted.seek_s:g}, the recording has {length_s:.2f} s")
            self._seek(stamp_ns)
        self._speed = self._speed if wanted.speed is None else wanted.speed
        if wanted.action is not None:
            self._is_paused = wanted.action is not ReplayAction.RESUME
            self._pause_ns = self._position_ns + (_STEP_NS if wanted.action is ReplayAction.STEP else 0)
        self._anchor = None
        return []

    def add_status(self, status: MapStatus) -> list[Message]:
        """In lockstep: the mapper's answer to a scan."""
        if self._lockstep is not None:
            self._lockstep.add_status(status)
        return []

    @property
    def _is_at_end(self) -> bool:
        return not self._kept and (self._next is None or self._due_ns > self._options.end_ns)

    @property
    def _is_over(self) -> bool:
        is_answered = self._lockstep is None or not self._lockstep.is_waiting
        return self._is_at_end and is_answered and not self._is_paused

    def _until_ns(self, now_ns: int) -> int:
        """The recorded time that has come."""
        if self._is_paused:
            return self._pause_ns
        if self._speed is None:
            return self._options.end_ns
        if self._anchor is None:
            self._anchor = (now_ns, self._position_ns)
        since_ns, stamp_ns = self._anchor
        return stamp_ns + round((now_ns - since_ns) * self._speed)

    def _take(self, until_ns: int, now_ns: int) -> Recorded | None:
        """The next message that is due, or None. What was kept at the place that was sought comes first, at once."""
        if self._kept:
            return self._kept.pop(0)
        while (recorded := self._next) is not None and not self._is_at_end and self._due_ns <= until_ns:
            if self._lockstep is None or not self._lockstep.is_left_out(recorded):
                if self._lockstep is not None and not self._lockstep.may_go(recorded, now_ns):
                    return None
                self._position_ns = self._due_ns
                self._read()
                return recorded
            self._read()
        return None

    def _sent(self, recorded: Recorded) -> list[Addressed]:
        try:
            message = recorded.message()
        except UnreadableError as error:
            self.unreadable.append(str(error))
            return []
        self.num_sent += 1
        if isinstance(message, Clock) and self._speed is not None:
            message = replace(message, real_time_factor=self._speed)
        return [Addressed(self._options.channels[recorded.channel], message)]

    def _seek(self, stamp_ns: int) -> None:
        """Goes on from there; the last message of each kept channel before it is given out again."""
        if self._lockstep is not None:
            self._lockstep.forget()
        self._messages = self._open()
        self._due_ns, self._anchor = 0, None
        kept: dict[Channel, Recorded] = {}
        self._read()
        while self._next is not None and self._due_ns < stamp_ns:
            if self._next.channel.is_kept:
                kept.pop(self._next.channel, None)
                kept[self._next.channel] = self._next
            self._read()
        self._kept = list(kept.values())
        self._position_ns = self._pause_ns = stamp_ns

    def _read(self) -> None:
        self._next = next(self._messages, None)
        if self._next is not None:
            self._due_ns = max(self._due_ns, self._next.log_ns)
