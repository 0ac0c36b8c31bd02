"""Counts what was missed, from the sequence numbers of what came."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class SequenceCounter:
    """Follows the `seq` of one publisher.

    A number at or below the last one means that the publisher was started again: it counts from zero then.
    """

    last_seq: int | None = None
    num_received: int = 0
    num_missed: int = 0

    def add(self, seq: int) -> int:
        """Takes the next `seq`; returns how many were missed before it. What came before the first is not known."""
        if self.last_seq is None:
            missed = 0
        elif seq > self.last_seq:
            missed = seq - self.last_seq - 1
        else:
            missed = seq
        self.last_seq = seq
        self.num_received += 1
        self.num_missed += missed
        return missed
