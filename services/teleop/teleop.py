"""What the page's buttons say to the robot, and what the robot says to the page. It knows neither bus nor browser."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from services.teleop import presses as p
from services.teleop.commander import Commander
from services.teleop.jog import Jog
from shared.geometry import Float
from shared.messaging.channels import JOINTS_TARGET
from shared.messaging.messages import (
    Clock,
    Event,
    Health,
    JointState,
    LegTarget,
    Message,
    RecorderControl,
    Severity,
    SimControl,
    Stop,
    Transforms,
)
from shared.messaging.values import MAX_SERVICES
from shared.runtime.config import TeleopConfig

M = TypeVar("M", bound=Message)

_NUM_LINES = 20
_JOINT_KEY = JOINTS_TARGET.key_expr


@dataclass(frozen=True, slots=True)
class Line:
    """One line of the page's log. stamp_ns: simulated time."""

    stamp_ns: int
    severity: Severity
    source: str
    text: str


class Teleop:
    """The facade. `press` and `tick` return the commands that follow; the robot's messages are noted.

    trajectory: the one that shall run now, None if none shall. lines: the newest last.
    """

    def __init__(
        self, config: TeleopConfig, max_velocity: Float, postures: Mapping[str, Float], trajectories: Sequence[str]
    ) -> None:
        self.commander = Commander(config.silence_s)
        self.jog = Jog(max_velocity, config.valid_s)
        self.lines: deque[Line] = deque(maxlen=_NUM_LINES)
        self.trajectory: str | None = None
        self.speed_share = config.speed_share
        self.is_following = True
        self.newest_static: Transforms | None = None
        self._postures, self._trajectories = postures, trajectories
        self._waiting: dict[int, float] = {}
        self._period_s = 1.0 / config.rate_hz
        self._due_s = self._now_s = 0.0
        self._newest: dict[type[Message], Message] = {}
        self._heartbeats: dict[str, tuple[float, Health]] = {}

    # ---- what people do

    def press(self, press: p.Presses, now_s: float) -> list[Message]:
        """What follows from something that was done on the page; a browser that only watches may stop, no more."""
        self._now_s = now_s
        match press:
            case p.Joined(client):
                self.commander.join(client, now_s)
            case p.Heard(client):
                self.commander.hear(client, now_s)
            case p.ControlTaken(client):
                self.commander.take(client)
            case p.Left(client):
                was_commander = self.commander.leave(client)
                return self._stop_if_busy("the page that commands was closed") if was_commander else []
            case p.Stopped(how=how):
                return self._stop(how)
            case _ if press.client == self.commander.client:
                return self._command(press)
            case _:
                self._say("only one page commands at a time: take control first")
        return []

    def tick(self, now_s: float) -> list[Message]:
        """The commands that are due by now; called often. now_s: a monotonic clock."""
        self._now_s = now_s
        if not self.commander.is_heard(now_s):
            return self._stop_if_busy("the page that commands does not answer")
        if now_s < self._due_s:
            return []
        self._due_s = now_s + self._period_s
        state, clock = self.newest(JointState), self.newest(Clock)
        if state is None:
            return []
        target = self.jog.next_target(state, self.speed_share, 1.0 if clock is None else clock.real_time_factor)
        return [] if target is None else [target]

    def close(self) -> list[Message]:
        """The last messages, when the page is ended."""
        return self._stop_if_busy("the page was ended")

    def _command(self, press: p.Presses) -> list[Message]:
        match press:
            case p.JointMoved(joint=joint, value=value):
                self._waiting[joint] = value
                return self._go() if self.is_following else []
            case p.GoPressed():
                return self._go()
            case p.PostureChosen(name=name):
                self._waiting = dict(enumerate(self._postures[name].tolist()))
                return self._go()
            case p.FollowingSet(is_following=is_following):
                self.is_following = is_following
            case p.SpeedSet(share=share):
                self.speed_share = share
            case p.TrajectoryChosen(name=name):
                return self._run(name)
            case _:
                return self._forwarded(press)
        return []

    def _forwarded(self, press: p.Presses) -> list[Message]:
        match press:
            case p.FootChosen(foot=foot):
                return [LegTarget(foot=foot)]
            case p.TimeAsked(control=control) | p.RecordingAsked(control=control):
                assert isinstance(control, SimControl | RecorderControl)
                return [control]
        return []

    def _go(self) -> list[Message]:
        if self.trajectory is not None:
            self._waiting.clear()
            self._say("a trajectory runs: end it before you move joints")
            return []
        self.jog.move(self._waiting)
        self._waiting.clear()
        return []

    def _run(self, name: str | None) -> list[Message]:
        if name is None:
            return self._stop_if_busy("the trajectory was ended")
        if name in self._trajectories:
            self.jog.cancel()
            self.trajectory = name
        return []

    def _stop(self, why: str) -> list[Message]:
        self._forget()
        return [Stop(text=f"teleop, {why}")]

    def _stop_if_busy(self, why: str) -> list[Message]:
        return self._stop(why) if self.is_busy else []

    def _forget(self) -> None:
        self._waiting.clear()
        self.jog.cancel()
        self.trajectory = None

    # ---- what the robot says

    def note(self, message: Message) -> list[Message]:
        """Keeps the newest message of its kind."""
        self._newest[type(message)] = message
        return []

    def note_static(self, transforms: Transforms) -> list[Message]:
        """Keeps where the map is in the world: the same kind of message as the robot's own transforms."""
        self.newest_static = transforms
        return []

    def add_event(self, event: Event) -> list[Message]:
        """Keeps what people should read; a refused target is not sent again."""
        self.lines.append(Line(event.stamp_ns, event.severity, event.source, event.text))
        if event.refused_key.endswith(_JOINT_KEY):
            self.jog.cancel()
        return []

    def add_stop(self, _stop: Stop) -> list[Message]:
        """Someone stopped the robot: nothing is renewed any more."""
        self._forget()
        return []

    def add_health(self, health: Health) -> list[Message]:
        """Notes a heartbeat."""
        if health.service in self._heartbeats or len(self._heartbeats) < MAX_SERVICES:
            self._heartbeats[health.service] = (self._now_s, health)
        return []

    def end_trajectory(self, text: str) -> None:
        """The trajectory that ran has ended by itself; text: how."""
        self.trajectory = None
        self._say(text, Severity.INFO if text.endswith("done") else Severity.WARNING)

    # ---- what the page shows

    @property
    def is_busy(self) -> bool:
        """Whether something that was set off here may still move the robot."""
        return bool(self.jog.joints) or self.trajectory is not None

    @property
    def moved_joints(self) -> frozenset[int]:
        """Joints whose sliders are a person's: on their way, or waiting for `GoPressed`."""
        return self.jog.joints | frozenset(self._waiting)

    def newest(self, kind: type[M]) -> M | None:
        """The newest message of a kind that was noted."""
        message = self._newest.get(kind)
        return message if isinstance(message, kind) else None

    def heartbeat_ages(self) -> dict[str, float]:
        """Seconds since the last heartbeat of each service that was ever heard, by name."""
        return {name: self._now_s - heard_s for name, (heard_s, _) in sorted(self._heartbeats.items())}

    def _say(self, text: str, severity: Severity = Severity.WARNING) -> None:
        clock = self.newest(Clock)
        self.lines.append(Line(0 if clock is None else clock.stamp_ns, severity, "teleop", text))
