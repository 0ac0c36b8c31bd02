"""Holds back the next scan of a replay until the mapper has said what became of the one before."""

from __future__ import annotations

from services.recorder.bag.recorded import Recorded
from shared.errors import HyrecroError
from shared.messaging.channels import Channel
from shared.messaging.messages import MapStatus

_PATIENCE_NS = 30 * 10**9
"""A mapper's longest search of a large map, and some."""


class ReplayError(HyrecroError):
    """A replay that cannot begin or go on; the text says why."""


class Lockstep:
    """scans: the recorded channel of what is mapped. used: the numbers of the scans to send; None: all of them."""

    def __init__(self, scans: Channel, used: frozenset[int] | None) -> None:
        self._scans, self._used = scans, used
        self._waiting_for: int | None = None
        self._since_ns = 0

    @property
    def is_waiting(self) -> bool:
        """Whether a scan has not been answered yet."""
        return self._waiting_for is not None

    def is_left_out(self, recorded: Recorded) -> bool:
        """Whether this is a scan that is not wanted."""
        return recorded.channel == self._scans and self._used is not None and recorded.seq not in self._used

    def may_go(self, recorded: Recorded, now_ns: int) -> bool:
        """Whether a message may be sent now; of a scan that may, the answer is waited for from now on."""
        if recorded.channel != self._scans:
            return True
        if self.is_waiting:
            return False
        self._waiting_for, self._since_ns = recorded.seq, now_ns
        return True

    def add_status(self, status: MapStatus) -> None:
        """Takes a mapper's answer."""
        if status.scan_seq == self._waiting_for:
            self._waiting_for = None

    def forget(self) -> None:
        """Waits for nothing: the replay goes on from elsewhere."""
        self._waiting_for = None

    def check(self, now_ns: int) -> None:
        """Raises:
        ReplayError: the mapper does not answer.
        """
        if self.is_waiting and now_ns - self._since_ns > _PATIENCE_NS:
            raise ReplayError(
                f"no map/status of scan {self._waiting_for} within {_PATIENCE_NS / 1e9:g} s: is a mapper running?"
            )
