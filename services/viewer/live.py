"""Draws what a robot says now."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from services.viewer.drawing import Drawn
from services.viewer.scene import Scene
from shared.messaging.channels import TF, Channel
from shared.messaging.messages import Measurement, Message

_MAX_DISORDER_NS = 500_000_000
"""Messages of two channels may come in another order than that of their stamps; by more, time has begun anew."""


class LiveView:
    """One run of a robot. draw: takes the drawings.

    newest_ns: simulated time that has been drawn up to, None before the first. is_over: simulated time has begun anew,
    by a reset or another simulation: what follows belongs to another run.
    """

    def __init__(self, draw: Callable[[Iterable[Drawn]], None]) -> None:
        self.newest_ns: int | None = None
        self.is_over = False
        self._scene, self._draw = Scene(), draw

    def show(self, channel: Channel, message: Message) -> list[Message]:
        """Draws one message; it says nothing itself."""
        if channel is TF and isinstance(message, Measurement):
            newest_ns = self.newest_ns or 0
            self.is_over = message.stamp_ns < newest_ns - _MAX_DISORDER_NS
            self.newest_ns = max(newest_ns, message.stamp_ns)
        if self.is_over or (isinstance(message, Measurement) and not self._scene.is_due(channel, message.stamp_ns)):
            return []
        self._draw(self._scene.draw(channel, message))
        return []
