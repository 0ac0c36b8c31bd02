"""Sends a foot target and follows the step, with progress on stderr."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from cli.playback import progress_bar
from shared.errors import BusError, HyrecroError
from shared.messaging.bus import Bus
from shared.messaging.channels import FOOT_STATUS, FOOT_TARGET
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Foot, FootPhase, FootStatus, FootTarget
from shared.runtime.config import Config

_PLANNING_TIMEOUT_S = 60.0
"""Until a target is accepted or refused: a search for a way takes seconds on a slow machine."""
_SILENCE_S = 5.0
"""Without a status for so long, the planner is asked for a sign of life; simulated time may be paused."""


class StepError(HyrecroError):
    """A step that did not get to its end; the text is the planner's."""


def step_foot(config: Config, target: FootTarget, is_stopping: Callable[[], bool]) -> Foot | None:
    """Returns the foot that now stands where it should, None when stopped by a signal.

    Raises:
        RefusedError: with the planner's reason. StepError: the step failed or was stopped by someone else.
        BusError: no router, no planner.
    """
    inbox = Inbox()
    with Bus(config.bus, is_stopping=is_stopping) as bus, progress_bar() as progress:
        bus.subscribe(FOOT_STATUS, inbox)
        task = progress.add_task("planning", total=1.0)
        bus.command(FOOT_TARGET, target, timeout_s=_PLANNING_TIMEOUT_S)
        for status in _statuses(bus, inbox, is_stopping):
            progress.update(
                task, completed=status.progress, description=f"foot {status.foot.value}: {status.phase.value}"
            )
            if status.phase is FootPhase.DONE:
                return status.foot
            if status.phase in (FootPhase.FAILED, FootPhase.STOPPED):
                raise StepError(f"foot {status.foot.value} {status.phase.value}: {status.text}")
    return None


def _statuses(bus: Bus, inbox: Inbox, is_stopping: Callable[[], bool]) -> Iterator[FootStatus]:
    """Those that come from now on; ends when stopping."""
    silent_s = 0.0
    while not is_stopping():
        parcel = inbox.take(timeout_s=0.1)
        if parcel is not None and not parcel.is_replay:
            silent_s = 0.0
            yield decode(FootStatus, parcel.payload, schema=parcel.schema)
        elif (silent_s := silent_s + 0.1) >= _SILENCE_S:
            silent_s = 0.0
            if "planner" not in bus.alive():
                raise BusError("the planner is gone")
