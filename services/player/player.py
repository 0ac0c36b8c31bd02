"""Plays a trajectory: sends intermediate targets at a fixed rate, waits until each row is reached, changes feet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.player.trajectory import ChangeFoot, MoveTo, Trajectory
from shared.errors import PlaybackError
from shared.messaging.messages import Event, Foot, JointState, JointTarget, LegState, LegTarget, Message, Severity
from shared.runtime.config import PlayerConfig


class Player:
    """The facade: told of states and ticks, it returns the next commands.

    `tick` is called `config.rate_hz` times a second; each `MoveTo` takes `config.num_steps` of them, along a straight
    line in joint space from where the robot was when the move began.

    Raises (from `tick` and `add_event`):
        PlaybackError: the robot refused a command or did not reach a target in time; the text names the line.
    """

    def __init__(self, config: PlayerConfig, trajectory: Trajectory) -> None:
        self._config = config
        self._trajectory = trajectory
        self._q: NDArray[np.float64] | None = None
        self._foot: Foot | None = None
        self._index = self._step = self._num_waits = 0
        self._start: NDArray[np.float64] | None = None
        self._foot_wanted: Foot | None = None

    @property
    def is_done(self) -> bool:
        """Whether every row has been reached."""
        return self._index == len(self._trajectory)

    @property
    def progress(self) -> float:
        """Share of the trajectory that is done, 0..1."""
        step = min(self._step / self._config.num_steps, 1.0)
        return 1.0 if self.is_done else (self._index + step) / len(self._trajectory)

    def add_joint_state(self, state: JointState) -> list[Message]:
        """Notes where the joints are."""
        self._q = state.q
        return []

    def add_leg_state(self, state: LegState) -> list[Message]:
        """Notes which foot is fixed."""
        self._foot = state.fixed_foot
        return []

    def add_event(self, event: Event) -> list[Message]:
        """Stops at a command that the robot refused."""
        if event.source == "sim" and event.severity is not Severity.INFO and not self.is_done:
            raise PlaybackError(f"line {self._trajectory[self._index].line}: {event.text}")
        return []

    def tick(self) -> list[Message]:
        """The commands that are due now."""
        if self.is_done or self._q is None or self._foot is None:
            return []
        move = self._trajectory[self._index]
        return self._tick_foot(move) if isinstance(move, ChangeFoot) else self._tick_joints(move, self._q)

    def _tick_foot(self, move: ChangeFoot) -> list[Message]:
        assert self._foot is not None
        if self._foot_wanted is None:
            self._foot_wanted = self._foot.other
            return [LegTarget(foot=self._foot_wanted)]
        if self._foot is self._foot_wanted:
            self._next_move()
            return self.tick()
        self._wait(move.line, f"foot {self._foot_wanted.value} to be fixed")
        return []

    def _tick_joints(self, move: MoveTo, q: NDArray[np.float64]) -> list[Message]:
        if self._start is None:
            self._start = q
        if self._step < self._config.num_steps:
            self._step += 1
            share = self._step / self._config.num_steps
            target = move.q if share == 1.0 else self._start + share * (move.q - self._start)
            return [JointTarget(q=target, duration_s=1.0 / self._config.rate_hz)]
        errors = np.abs(q - move.q)
        if errors.max() <= self._config.position_tolerance:
            self._next_move()
            return self.tick()
        worst = int(errors.argmax())
        self._wait(move.line, f"q{worst + 1} to go from {q[worst]:.4f} to {move.q[worst]:.4f}")
        return []

    def _next_move(self) -> None:
        self._index += 1
        self._step = self._num_waits = 0
        self._start = self._foot_wanted = None

    def _wait(self, line: int, what: str) -> None:
        self._num_waits += 1
        if self._num_waits > self._config.timeout_s * self._config.rate_hz:
            raise PlaybackError(f"line {line}: waited {self._config.timeout_s:g} s for {what}")
