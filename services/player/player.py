"""Plays a trajectory: sends intermediate targets at a fixed rate, waits until each row is reached, changes feet."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from services.player.trajectory import ChangeFoot, MoveTo, Trajectory
from shared.errors import PlaybackError, StoppedError
from shared.messaging.messages import (
    JOINT_NAMES,
    Event,
    Foot,
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    Message,
    Severity,
    Stop,
)
from shared.robot.ramps import ramped_share
from shared.runtime.config import PlayerConfig

_RADIANS_PER_METRE = 10.0
"""A piston's metre counts as so many radians, so that a whole stroke takes as long as half a radian."""
_REPEAT_S = 1.0
"""What is waited for so long, in simulated time, was not heard: it is asked for again."""
_WEIGHTS = np.array([_RADIANS_PER_METRE if name in ("q2", "q7") else 1.0 for name in JOINT_NAMES])


class Player:
    """The facade: told of states, it returns the commands that are due then, in simulated time.

    Commands are sent `config.rate_hz` times a second; each `MoveTo` is a straight line in joint space from where the
    robot was when the move began, at `config.speed_radps`, or in `config.num_steps` commands if no speed is set. A
    simulation that was killed and goes on finds the row where it was; what nobody heard is sent again.

    Raises (from `add_joint_state`, `add_event` and `stop`):
        PlaybackError: the robot refused a command, fell, or did not reach a target in time; the text names the line.
        StoppedError: someone stopped the robot.
    """

    def __init__(self, config: PlayerConfig, trajectory: Trajectory) -> None:
        self._config = config
        self._trajectory = trajectory
        self._period_ns = round(1e9 / config.rate_hz)
        self._stamp_ns = self._due_ns = 0
        self._foot: Foot | None = None
        self._index = self._step = self._num_waits = 0
        self._num_steps = 1
        self._start: NDArray[np.float64] | None = None
        self._last: NDArray[np.float64] | None = None
        self._foot_wanted: Foot | None = None

    @property
    def is_done(self) -> bool:
        """Whether every row has been reached."""
        return self._index == len(self._trajectory)

    @property
    def progress(self) -> float:
        """Share of the trajectory that is done, 0..1."""
        step = min(self._step / self._num_steps, 1.0)
        return 1.0 if self.is_done else (self._index + step) / len(self._trajectory)

    def add_leg_state(self, state: LegState) -> list[Message]:
        """Notes which foot is fixed."""
        self._foot = state.fixed_foot
        return []

    def add_event(self, event: Event) -> list[Message]:
        """Stops at a command that the robot refused, and at a fall."""
        is_bad = event.refused_key or event.severity is Severity.ERROR
        if event.source == "sim" and is_bad and not self.is_done:
            raise PlaybackError(f"line {self._trajectory[self._index].line}: {event.text}")
        return []

    def stop(self, stop: Stop) -> list[Message]:
        """Ends the trajectory where it is."""
        if self.is_done:
            return []
        raise StoppedError(f"line {self._trajectory[self._index].line}: {stop.reason}")

    def add_joint_state(self, state: JointState) -> list[Message]:
        """The commands that are due at its stamp. Where simulated time stands still, so does the player."""
        if state.stamp_ns < self._stamp_ns:  # the simulation was started again
            self._due_ns = state.stamp_ns
        self._stamp_ns = state.stamp_ns
        if self.is_done or self._foot is None or state.stamp_ns < self._due_ns:
            return []
        is_late = state.stamp_ns >= self._due_ns + self._period_ns
        self._due_ns = (state.stamp_ns if is_late else self._due_ns) + self._period_ns
        return self._advance(state.q)

    def _advance(self, q: NDArray[np.float64]) -> list[Message]:
        if self.is_done:
            return []
        move = self._trajectory[self._index]
        return self._change_foot(move, q) if isinstance(move, ChangeFoot) else self._move_joints(move, q)

    def _change_foot(self, move: ChangeFoot, q: NDArray[np.float64]) -> list[Message]:
        assert self._foot is not None
        if self._foot_wanted is None:
            self._foot_wanted = self._foot.other
            return [LegTarget(foot=self._foot_wanted)]
        if self._foot is self._foot_wanted:
            self._next_move()
            return self._advance(q)
        return self._wait(move.line, f"foot {self._foot_wanted.value} to be fixed", LegTarget(foot=self._foot_wanted))

    def _move_joints(self, move: MoveTo, q: NDArray[np.float64]) -> list[Message]:
        if self._start is None:
            self._start = q if self._last is None else self._last  # what was commanded has no noise
            self._last = move.q
            self._num_steps = self._steps_between(self._start, move.q)
        if self._step < self._num_steps:
            self._step += 1
            share = self._share(self._step / self._config.rate_hz)
            target = move.q if self._step == self._num_steps else self._start + share * (move.q - self._start)
            return [JointTarget(q=target, duration_s=1.0 / self._config.rate_hz)]
        errors = np.abs(q - move.q)
        is_over = self._num_waits > 0  # the last command takes a period: what is near by then may still move
        if is_over and errors.max() <= self._config.position_tolerance:
            self._next_move()
            return self._advance(q)
        worst = int(errors.argmax())
        what = f"q{worst + 1} to go from {q[worst]:.4f} to {move.q[worst]:.4f}"
        return self._wait(move.line, what, JointTarget(q=move.q, duration_s=1.0 / self._config.rate_hz))

    def _steps_between(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> int:
        if self._config.speed_radps is None:
            return self._config.num_steps
        way = float(np.max(np.abs(end - start) * _WEIGHTS))
        needed_s = way / self._config.speed_radps + self._config.ramp_s
        return max(1, math.ceil(max(needed_s, 2 * self._config.ramp_s) * self._config.rate_hz))

    def _share(self, elapsed_s: float) -> float:
        """Share of the way to the next target: even, or with a ramp at either end where a speed is set."""
        total_s = self._num_steps / self._config.rate_hz
        ramp_s = min(self._config.ramp_s, total_s / 2) if self._config.speed_radps is not None else 0.0
        return ramped_share(elapsed_s, total_s, ramp_s)[0]

    def _next_move(self) -> None:
        self._index += 1
        self._step = self._num_waits = 0
        self._start = self._foot_wanted = None

    def _wait(self, line: int, what: str, command: Message) -> list[Message]:
        """Waits for what a command shall lead to; now and then it is sent again."""
        self._num_waits += 1
        if self._num_waits > self._config.timeout_s * self._config.rate_hz:
            raise PlaybackError(f"line {line}: waited {self._config.timeout_s:g} s for {what}")
        is_due = self._num_waits % max(1, round(_REPEAT_S * self._config.rate_hz)) == 0
        return [command] if is_due else []
