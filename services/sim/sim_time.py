"""Simulated time: how far it is, whether it runs, and how fast it shall."""

from __future__ import annotations

from services.sim.state import TimeState
from shared.errors import RefusedError
from shared.messaging.messages import SimAction, SimControl

MIN_FACTOR, MAX_FACTOR = 0.01, 100.0
MAX_STEPS = 1_000_000


class SimTime:
    """Counts periods of 1 / rate_hz. It never goes back, also not at a reset."""

    def __init__(self, rate_hz: float, real_time_factor: float) -> None:
        self._rate_hz = rate_hz
        self._factor = real_time_factor
        self._num_periods = self._num_single = 0
        self._is_paused = False

    @property
    def stamp_ns(self) -> int:
        """Now."""
        return self._stamp_ns(self._num_periods)

    @property
    def num_periods(self) -> int:
        """How many periods have passed."""
        return self._num_periods

    @property
    def wall_hz(self) -> float:
        """How often a second the next period is due on the wall's clock."""
        return self._rate_hz * self._factor

    @property
    def real_time_factor(self) -> float:
        """Wanted seconds of simulated time a second; 0 while it is paused."""
        return 0.0 if self._is_paused else self._factor

    def snapshot(self) -> TimeState:
        """What `restore` needs."""
        return TimeState(
            num_periods=self._num_periods,
            num_single=self._num_single,
            is_paused=self._is_paused,
            factor=self._factor,
        )

    def restore(self, state: TimeState) -> None:
        """Goes on one period later."""
        self._num_periods, self._num_single = state.num_periods + 1, state.num_single
        self._is_paused, self._factor = state.is_paused, state.factor

    def advance(self) -> tuple[int, int] | None:
        """Goes on by one period, if it runs or single steps are left: the stamps before and after it."""
        if self._is_paused and self._num_single == 0:
            return None
        self._num_single = max(0, self._num_single - 1)
        self._num_periods += 1
        return self._stamp_ns(self._num_periods - 1), self.stamp_ns

    def control(self, control: SimControl) -> None:
        """Pauses, resumes, steps, changes the pace; what concerns the robot is left to others.

        Raises:
            RefusedError: a step while time runs, a number of steps or a pace that cannot be.
        """
        factor, num_steps = control.real_time_factor, control.num_steps
        if factor is not None and not MIN_FACTOR <= factor <= MAX_FACTOR:
            raise RefusedError(f"real_time_factor is {factor:g}, must be within {MIN_FACTOR:g}..{MAX_FACTOR:g}")
        if num_steps is not None and not 1 <= num_steps <= MAX_STEPS:
            raise RefusedError(f"num_steps is {num_steps}, must be within 1..{MAX_STEPS}")
        if control.action is SimAction.STEP and not self._is_paused:
            raise RefusedError("step needs a paused simulation: send pause first")
        self._factor = self._factor if factor is None else factor
        if control.action is SimAction.STEP:
            self._num_single += num_steps or 1
        if control.action in (SimAction.PAUSE, SimAction.RESUME):
            self._is_paused, self._num_single = control.action is SimAction.PAUSE, 0

    def _stamp_ns(self, num_periods: int) -> int:
        return round(num_periods * 1e9 / self._rate_hz)
