"""What a recorder that was killed leaves to the next one: which run it was writing."""

from __future__ import annotations

from dataclasses import dataclass

from shared.messaging.messages import Message


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecorderState(Message):
    """run: "" where nothing shall be recorded; channels: patterns. num_statuses: that it has said.

    configured: the setting recorder.run under which it ran.
    """

    configured: str
    run: str
    channels: tuple[str, ...]
    num_statuses: int
    has_lost: bool
