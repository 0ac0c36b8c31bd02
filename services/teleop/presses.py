"""What a person does on the page, as values; `client` is the browser it was done in."""

from __future__ import annotations

from dataclasses import dataclass

from shared.messaging.messages import Foot, RecorderControl, SimControl


@dataclass(frozen=True, slots=True)
class Press:
    """Base of all of them."""

    client: int


class Joined(Press):
    """A browser has opened the page."""


class Left(Press):
    """A browser is gone: closed, or its connection lost."""


class Heard(Press):
    """A browser has answered: its page is alive, not only its connection."""


class ControlTaken(Press):
    """A browser commands from now on, the others watch."""


@dataclass(frozen=True, slots=True)
class Stopped(Press):
    """The stop: anybody may. how: what was pressed."""

    how: str


@dataclass(frozen=True, slots=True)
class JointMoved(Press):
    """A slider was moved. joint: 0..7; value: radians or metres."""

    joint: int
    value: float


class GoPressed(Press):
    """The sliders that were moved shall be followed now."""


@dataclass(frozen=True, slots=True)
class FollowingSet(Press):
    """Whether the robot follows a slider while it is moved."""

    is_following: bool


@dataclass(frozen=True, slots=True)
class SpeedSet(Press):
    """Share of the joints' velocity limits, above 0 up to 1."""

    share: float


@dataclass(frozen=True, slots=True)
class PostureChosen(Press):
    """All joints shall go to a named posture."""

    name: str


@dataclass(frozen=True, slots=True)
class FootChosen(Press):
    """A foot shall be the fixed one."""

    foot: Foot


@dataclass(frozen=True, slots=True)
class TrajectoryChosen(Press):
    """A trajectory shall be run; None: the one that runs shall end."""

    name: str | None


@dataclass(frozen=True, slots=True)
class TimeAsked(Press):
    """Something is asked of simulated time."""

    control: SimControl


@dataclass(frozen=True, slots=True)
class RecordingAsked(Press):
    """Something is asked of the recorder."""

    control: RecorderControl


Presses = (
    Joined
    | Left
    | Heard
    | ControlTaken
    | Stopped
    | JointMoved
    | GoPressed
    | FollowingSet
    | SpeedSet
    | PostureChosen
    | FootChosen
    | TrajectoryChosen
    | TimeAsked
    | RecordingAsked
)
