"""Watches over a joint target that is valid for a while only: its commander has to renew it."""

from __future__ import annotations

from shared.messaging.messages import JointTarget


class Vigil:
    """At most one target is watched, from `begin` until `end`; without `valid_s` there is nothing to watch."""

    def __init__(self) -> None:
        self._target: JointTarget | None = None
        self._until_ns = 0

    def begin(self, target: JointTarget, stamp_ns: int) -> None:
        """Watches this target from now on."""
        self._target = None if target.valid_s is None else target
        self._until_ns = stamp_ns + round((target.valid_s or 0.0) * 1e9)

    def renew(self, target: JointTarget, stamp_ns: int) -> bool:
        """Whether the target is the one that is watched; if so, it is valid anew."""
        is_same = self._target is not None and self._target == target
        if is_same:
            self.begin(target, stamp_ns)
        return is_same

    def is_over(self, stamp_ns: int) -> bool:
        """Whether the target has not been renewed in time."""
        return self._target is not None and stamp_ns >= self._until_ns

    def end(self) -> None:
        """Watches no longer."""
        self._target = None
