"""Numbers what the simulation says, each kind of message from zero up."""

from __future__ import annotations

from collections import Counter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from shared.messaging.messages import (
    ActuatorState,
    Clock,
    Event,
    FixedFootDescription,
    JointState,
    LegState,
    Measurement,
    RobotDescription,
    StructureDescription,
    Transforms,
)

M = TypeVar("M", bound=Measurement)

_KINDS: tuple[type[Measurement], ...] = (
    JointState,
    ActuatorState,
    Transforms,
    Clock,
    LegState,
    RobotDescription,
    FixedFootDescription,
    StructureDescription,
    Event,
)


class Numbering:
    """Counts by kind."""

    def __init__(self) -> None:
        self._num_sent: Counter[type[Measurement]] = Counter()

    def stamped(self, kind: type[M], stamp_ns: int, frame: str, **fields: Any) -> M:
        """The next message of its kind."""
        seq = self._num_sent[kind]
        self._num_sent[kind] += 1
        return kind(stamp_ns=stamp_ns, seq=seq, frame=frame, **fields)

    def snapshot(self) -> NDArray[np.int64]:
        """The counts (K,)."""
        return np.array([self._num_sent[kind] for kind in _KINDS])

    def restore(self, num_sent: NDArray[np.int64]) -> None:
        """Goes on from counts (K,).

        Raises:
            ValueError: there are not as many as kinds.
        """
        self._num_sent = Counter(dict(zip(_KINDS, num_sent.tolist(), strict=True)))
