"""Wiring of a replay."""

from __future__ import annotations

from collections.abc import Iterable

from services.recorder.replay.replay import Replay
from shared.messaging.channels import MAP_STATUS, REPLAY_CONTROL, Channel
from shared.runtime.node import Context, Handler, Node

_TIMER_HZ = 200.0
"""So that nothing comes later than 5 ms."""


def replay_node(replay: Replay, channels: Iterable[Channel], context: Context, *, is_lockstep: bool) -> Node:
    """The node that publishes a recording on these channels until it is at its end."""
    inputs: dict[Channel, Handler] = {REPLAY_CONTROL: replay.control}
    if is_lockstep:
        inputs[MAP_STATUS] = replay.add_status
    return Node(
        name="replay",
        inputs=inputs,
        outputs=tuple(channels),
        on_timer=lambda: replay.due(context.clock_ns()),
        timer_hz=_TIMER_HZ,
        is_done=lambda: replay.is_done,
    )
