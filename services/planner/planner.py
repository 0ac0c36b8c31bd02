"""Puts a foot where it is told to: plans the step, sends it piece by piece, says how it goes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from services.planner.footing import snapped, stand_text
from services.planner.schedule import Schedule
from services.planner.state import PlannerState
from services.planner.step_planning import StepPlan, plan_step
from shared.climbing.climber import Climber
from shared.climbing.stance import Stance
from shared.errors import RefusedError
from shared.geometry import SE3, Float
from shared.messaging.channels import JOINTS_TARGET, LEG_TARGET
from shared.messaging.messages import (
    Event,
    Foot,
    FootPhase,
    FootStatus,
    FootTarget,
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    Message,
    Pose,
    Severity,
    Stop,
)
from shared.runtime.config import PlannerConfig

_STATUS_PERIOD_NS = 500_000_000
_REPEAT_NS = 1_000_000_000
"""A foot that is not fixed by then, in simulated time, is asked for again: nobody may have heard."""
_WORLD = "world"
_OWN_KEYS = (JOINTS_TARGET.key_expr, LEG_TARGET.key_expr)


@dataclass(slots=True, eq=False)
class _Step:
    """A step under way. sent_s: up to where of the schedule targets were sent; due_ns: when the next one is due."""

    plan: StepPlan
    schedule: Schedule
    phase: FootPhase = FootPhase.PLANNING
    sent_s: float = 0.0
    due_ns: int = 0
    waits_since_ns: int = 0
    asked_ns: int | None = None

    @property
    def foot(self) -> Foot:
        return self.plan.stance.free_foot

    @property
    def progress(self) -> float:
        return self.sent_s / max(self.schedule.duration_s, 1e-9)


class StepPlanner:
    """The facade: a foot target is planned or refused at once; joint states then drive it, by their stamps.

    Time is the simulation's: a pause of it pauses the step. No intermediate target is ever left out: if states come
    late, the step takes longer.
    """

    def __init__(self, config: PlannerConfig, climber: Climber, seed: int) -> None:
        self._config = config
        self._climber = climber
        self._seed = seed
        self._period_ns = round(1e9 / config.rate_hz)
        self._joints: JointState | None = None
        self._leg: LegState | None = None
        self._q_sent: Float | None = None
        self._step: _Step | None = None
        self._told: list[Message] = []
        self._num_statuses = 0
        self._status_due_ns = 0

    def snapshot(self) -> PlannerState:
        """What `restore` needs."""
        step = self._step
        return PlannerState(
            num_statuses=self._num_statuses,
            stamp_ns=0 if self._joints is None else self._joints.stamp_ns,
            foot=None if step is None else step.foot,
            progress=0.0 if step is None else step.progress,
        )

    def restore(self, state: PlannerState) -> list[Message]:
        """Says that the step has ended in which another planner was killed: its targets end by themselves."""
        self._num_statuses = state.num_statuses
        if state.foot is None:
            return []
        text = "the planner was started again: the step has ended where it was"
        return [self._status(state.foot, FootPhase.STOPPED, state.progress, text, stamp_ns=state.stamp_ns)]

    @property
    def is_busy(self) -> bool:
        """Whether a step is under way."""
        return self._step is not None

    def add_foot_target(self, target: FootTarget) -> list[Message]:
        """Plans the step; it begins with the next joint state.

        Raises:
            RefusedError: no state of the robot yet, a step under way, or why the target cannot be reached.
        """
        if self._joints is None or self._leg is None:
            raise RefusedError("no state of the robot has come yet")
        if self._step is not None:
            raise RefusedError(f"a step of foot {self._step.foot.value} is under way")
        fixed = Stance(self._leg.fixed_foot, SE3.from_xyz_quat_xyzw(self._leg.T_world_foot))
        q = self._q_now(self._joints.q)
        foot = target.foot or fixed.free_foot
        try:
            stance = fixed if foot is fixed.free_foot else self._changed(fixed, q)
            rng = np.random.default_rng(self._seed)
            plan = plan_step(target, stance, q, self._climber, self._config, rng)
        except RefusedError as error:
            self._told.append(self._status(foot, FootPhase.REFUSED, 0.0, str(error)))
            raise
        schedule = Schedule(plan, self._climber.max_velocity, self._config.speed_share, self._config.ramp_s)
        self._step = _Step(plan, schedule)
        return [self._step_status(self._step, FootPhase.PLANNING)]

    def add_joint_state(self, state: JointState) -> list[Message]:
        """Sends what is due, and how far the step is."""
        is_reset = self._joints is not None and state.stamp_ns < self._joints.stamp_ns
        self._joints = state
        messages, self._told = self._told, []
        if self._step is None:
            return messages
        if is_reset:
            return [*messages, self._end(self._step, FootPhase.STOPPED, "simulated time was set back")]
        return [*messages, *self._advance(self._step, state)]

    def add_leg_state(self, state: LegState) -> list[Message]:
        """Notes where the robot stands; a change of foot by someone else ends the step."""
        self._leg = state
        step = self._step
        if step is None or step.phase is FootPhase.PLANNING or state.fixed_foot is step.plan.stance.fixed_foot:
            return []
        return [self._end(step, FootPhase.STOPPED, f"someone fixed foot {state.fixed_foot.value}")]

    def add_event(self, event: Event) -> list[Message]:
        """Ends the step when the simulation refuses such a command as it sends, or the robot falls."""
        is_bad = event.refused_key.endswith(_OWN_KEYS) or event.severity is Severity.ERROR
        if self._step is None or event.source != "sim" or not is_bad:
            return []
        return [self._end(self._step, FootPhase.FAILED, event.text)]

    def stop(self, stop: Stop) -> list[Message]:
        """Ends the step where it is; the posture is then what the encoders read."""
        self._q_sent = None
        return [] if self._step is None else [self._end(self._step, FootPhase.STOPPED, stop.reason)]

    def _q_now(self, q_read: Float) -> Float:
        """The posture (8,): what was commanded last, which has no noise, if the encoders agree; else what they read."""
        if self._q_sent is not None and np.abs(q_read - self._q_sent).max() <= self._config.joint_tolerance:
            return self._q_sent
        return np.asarray(np.clip(q_read, self._climber.lower, self._climber.upper))

    def _changed(self, fixed: Stance, q: Float) -> Stance:
        """The stance with the other foot fixed, if it stands on steel as far as the encoders can tell."""
        T_world_free = fixed.T_world_free(q)
        T_world_foot = snapped(T_world_free, self._climber.steel)
        if T_world_foot is None:
            fixed_foot, free_foot = fixed.fixed_foot.value, fixed.free_foot.value
            reason = stand_text(T_world_free, self._climber.steel)
            raise RefusedError(f"foot {fixed_foot} is fixed, and foot {free_foot} cannot take over: {reason}")
        return Stance(fixed.free_foot, T_world_foot)

    def _advance(self, step: _Step, state: JointState) -> list[Message]:
        if step.phase is FootPhase.PLANNING and not self._is_standing(step):
            return self._ask_for_foot(step, state.stamp_ns)
        if step.sent_s < step.schedule.duration_s:
            return self._send_next(step, state.stamp_ns)
        return self._await_arrival(step, state)

    def _is_standing(self, step: _Step) -> bool:
        return self._leg is not None and self._leg.fixed_foot is step.plan.stance.fixed_foot

    def _ask_for_foot(self, step: _Step, stamp_ns: int) -> list[Message]:
        wanted = step.plan.stance.fixed_foot
        if step.asked_ns is None:
            step.asked_ns = step.waits_since_ns = stamp_ns
            return [LegTarget(foot=wanted)]
        if self._has_waited(step, stamp_ns):
            return [self._end(step, FootPhase.FAILED, f"foot {wanted.value} was not fixed{self._waited}")]
        if stamp_ns - step.asked_ns >= _REPEAT_NS:
            step.asked_ns = stamp_ns
            return [LegTarget(foot=wanted)]
        return []

    def _send_next(self, step: _Step, stamp_ns: int) -> list[Message]:
        if step.phase is FootPhase.PLANNING:
            step.due_ns = stamp_ns
        if stamp_ns < step.due_ns:
            return []
        start_s = step.sent_s
        step.sent_s = min(start_s + self._period_ns / 1e9, step.schedule.duration_s)
        is_on_time = stamp_ns < step.due_ns + self._period_ns
        step.due_ns = (step.due_ns if is_on_time else stamp_ns) + self._period_ns
        step.waits_since_ns = stamp_ns
        self._q_sent = step.schedule.q_at(step.sent_s)
        target = JointTarget(q=self._q_sent, duration_s=max(step.sent_s - start_s, 1e-6))
        return [target, *self._progress(step, step.schedule.phase_at(step.sent_s), stamp_ns)]

    def _await_arrival(self, step: _Step, state: JointState) -> list[Message]:
        away = np.abs(state.q - step.schedule.q_end)
        if away.max() <= self._config.joint_tolerance and state.stamp_ns >= step.due_ns:
            return [self._end(step, FootPhase.DONE, "")]
        if self._has_waited(step, state.stamp_ns):
            i = int(away.argmax())
            text = f"q{i + 1} is {state.q[i]:.4f} instead of {step.schedule.q_end[i]:.4f}{self._waited}"
            return [self._end(step, FootPhase.FAILED, text)]
        return self._progress(step, step.phase, state.stamp_ns)

    def _has_waited(self, step: _Step, stamp_ns: int) -> bool:
        return stamp_ns - step.waits_since_ns > self._config.timeout_s * 1e9

    @property
    def _waited(self) -> str:
        return f" within {self._config.timeout_s:g} s"

    def _progress(self, step: _Step, phase: FootPhase, stamp_ns: int) -> list[Message]:
        if phase is step.phase and stamp_ns < self._status_due_ns:
            return []
        self._status_due_ns = stamp_ns + _STATUS_PERIOD_NS
        return [self._step_status(step, phase)]

    def _end(self, step: _Step, phase: FootPhase, text: str) -> FootStatus:
        self._step = None
        return self._step_status(step, phase, text)

    def _step_status(self, step: _Step, phase: FootPhase, text: str = "") -> FootStatus:
        step.phase = phase
        share = 1.0 if phase is FootPhase.DONE else step.progress
        goal, duration_s = step.plan.T_world_goal.xyz_quat_xyzw, step.schedule.duration_s
        return self._status(step.foot, phase, share, text, goal, duration_s, step.plan.margin)

    def _status(
        self,
        foot: Foot,
        phase: FootPhase,
        progress: float,
        text: str,
        T_world_goal: Pose | None = None,
        duration_s: float | None = None,
        margin: float | None = None,
        stamp_ns: int = 0,
    ) -> FootStatus:
        self._num_statuses += 1
        return FootStatus(
            stamp_ns=stamp_ns if self._joints is None else self._joints.stamp_ns,
            seq=self._num_statuses - 1,
            frame=_WORLD,
            foot=foot,
            phase=phase,
            progress=progress,
            text=text,
            T_world_goal=T_world_goal,
            duration_s=duration_s,
            margin=margin,
        )
