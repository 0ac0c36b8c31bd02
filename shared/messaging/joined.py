"""Whether two joined routers hear each other, or are connected and no more."""

from __future__ import annotations

_NUM_LOOKS = 3
"""In a row: a router that has just joined has not told everything yet."""


class SplitWatch:
    """Follows which routers are connected and which are heard. One never heard may be none of ours: left alone."""

    def __init__(self) -> None:
        self._known: set[str] = set()
        self._num_looks = 0

    def is_split(self, connected: set[str], heard: set[str]) -> bool:
        """Whether, for the third time in a row, one is connected and not heard that was heard before."""
        self._known |= heard
        self._num_looks = self._num_looks + 1 if (connected & self._known) - heard else 0
        if self._num_looks < _NUM_LOOKS:
            return False
        self._num_looks = 0
        return True
