"""Counts what was missed, from the sequence numbers of what came."""

from __future__ import annotations

from dataclasses import dataclass, field

_MAX_REMEMBERED = 1000
"""So many of the last missed numbers may still come; later ones count as a new start."""


@dataclass(slots=True)
class SequenceCounter:
    """Follows the `seq` of one publisher.

    A missed number that comes after all, as when an answer to a question overtakes what was sent before it, is missed
    no longer. Any other number at or below the last one means that the publisher was started again: it counts from
    zero then.
    """

    last_seq: int | None = None
    num_received: int = 0
    num_missed: int = 0
    _missing: dict[int, None] = field(default_factory=dict)

    def is_late(self, seq: int) -> bool:
        """Whether it was missed and comes after all."""
        return seq in self._missing

    def add(self, seq: int) -> int:
        """Takes the next `seq`; returns how many were missed before it, or -1 if it was among them itself.

        What came before the first is not known.
        """
        self.num_received += 1
        if self.is_late(seq):
            del self._missing[seq]
            missed = -1
        else:
            missed = self._gap(seq)
            self.last_seq = seq
        self.num_missed += missed
        return missed

    def _gap(self, seq: int) -> int:
        if self.last_seq is None:
            return 0
        is_new_start = seq <= self.last_seq
        first = 0 if is_new_start else self.last_seq + 1
        if is_new_start:
            self._missing.clear()
        self._missing |= dict.fromkeys(range(max(first, seq - _MAX_REMEMBERED), seq))
        for oldest in list(self._missing)[: max(0, len(self._missing) - _MAX_REMEMBERED)]:
            del self._missing[oldest]
        return seq - first
