"""The simulated robot: it takes commands, and each step of simulated time says how it stands."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np

from services.sim.actuation import actuator_geometry, actuator_motion
from services.sim.building import build_body, check_robot, generators
from services.sim.encoders import Encoders
from services.sim.link_tree import FIXED_FOOT_FRAME, WORLD_FRAME, LinkTree
from services.sim.motion import JointMotion, plan_motion
from services.sim.numbering import Numbering
from services.sim.sim_time import SimTime
from services.sim.slip import Slip
from services.sim.state import SimState
from services.sim.stroke_watch import StrokeWatch
from services.sim.targets import resolve_actuators, resolve_joints
from services.sim.vigil import Vigil
from shared.errors import RefusedError
from shared.geometry import Float
from shared.messaging.messages import (
    JOINT_NAMES,
    ActuatorState,
    ActuatorTarget,
    Clock,
    Event,
    FixedFootDescription,
    JointState,
    JointTarget,
    LegState,
    LegTarget,
    Measurement,
    Message,
    RobotDescription,
    Severity,
    SimAction,
    SimControl,
    Stop,
    StructureDescription,
    Transforms,
)
from shared.robot.actuators import actuators_from_joints
from shared.robot.limits import joint_bounds
from shared.robot.urdf import parse_urdf
from shared.runtime.config import SimConfig
from shared.world.structure import Structure
from shared.world.urdf_format import structure_urdf

M = TypeVar("M", bound=Measurement)

_DEAF_NS = 200_000_000
"""Targets that come so soon after a stop were sent before their commander knew of it."""
_MAX_SLIDE_MPS = 0.05
"""How fast a core link slides: the velocity limit of the pistons."""


class ClimbingSim:
    """The facade. Commands set a motion off; each `step` advances simulated time by 1 / `config.rate_hz`.

    Mode kinematic: however the joints move, the fixed foot stands still to 1e-9 m; changing it moves no link at all.
    Mode dynamic: masses, drives and magnets decide, and the robot can fall.

    urdf_text: the robot. mark_text: the URDF of the mark that viewers draw at the fixed foot. seed: of encoders and
    slips. source: where `urdf_text` comes from, for errors.

    Raises:
        InputFileError: the URDF is malformed, or not of this robot.
    """

    def __init__(
        self,
        config: SimConfig,
        urdf_text: str,
        structure: Structure,
        mark_text: str,
        seed: int = 0,
        source: str = "robot URDF",
    ) -> None:
        model = parse_urdf(urdf_text, source)
        check_robot(model, source)
        self._config = config
        self._urdf_text, self._mark_text, self._structure = urdf_text, mark_text, structure
        self._lower, self._upper = joint_bounds(model)
        self._max_velocity = np.array([model.limits[name].velocity for name in JOINT_NAMES])
        self._ramp_s = config.dynamics.ramp_s if config.mode == "dynamic" else 0.0
        self._actuators = actuator_geometry(config.actuators)
        self._strokes = StrokeWatch(self._actuators)
        self._time = SimTime(config.rate_hz, config.real_time_factor)
        self._numbering = Numbering()
        encoder_rng, slip_rng = generators(seed)
        self._encoders = Encoders(config.encoders, encoder_rng)
        self._slip = Slip(config.slip, slip_rng)
        self._body = build_body(config, urdf_text, model, structure, self._slip)
        self._tree = LinkTree(model, self._body.links)
        self._vigil = Vigil()
        self._deaf_until_ns = 0
        self._stop(np.zeros(2))

    @property
    def wall_hz(self) -> float:
        """How often a second `step` is due on the wall's clock."""
        return self._time.wall_hz

    def snapshot(self) -> SimState:
        """What `restore` needs."""
        return SimState(
            time=self._time.snapshot(),
            body=self._body.snapshot(),
            num_sent=self._numbering.snapshot(),
            slides=self._slides.at(self._time.stamp_ns)[0],
            bias=self._encoders.bias,
            encoder_rng=self._encoders.rng_text,
            slip_rng=self._slip.rng_text,
            deaf_until_ns=self._deaf_until_ns,
        )

    def restore(self, state: SimState) -> list[Message]:
        """Goes on where another was killed, a period later, so that no stamp is told twice, and at rest.

        Raises:
            ValueError: it is no state of this simulation.
        """
        self._encoders.restore(state.bias, state.encoder_rng)
        self._slip.restore(state.slip_rng)
        self._numbering.restore(state.num_sent)
        self._time.restore(state.time)
        self._body.restore(state.body, self._time.stamp_ns)
        self._deaf_until_ns = state.deaf_until_ns
        self._stop(state.slides)
        where = f"foot {state.body.fixed_foot.value} is fixed, the joints stand where they were"
        return [*self._events([f"restored at {self._time.stamp_ns / 1e9:.2f} s: {where}"])]

    def start(self) -> list[Message]:
        """The descriptions and the first states: at time zero, or where it goes on."""
        robot = self._stamped(RobotDescription, self._tree.root, urdf=self._urdf_text)
        mark = self._stamped(FixedFootDescription, FIXED_FOOT_FRAME, urdf=self._mark_text)
        structure = self._stamped(StructureDescription, WORLD_FRAME, urdf=structure_urdf(self._structure))
        return [robot, mark, structure, *self._states(), self._leg_state()]

    def step(self) -> list[Message]:
        """The states one step later; nothing while simulated time is paused."""
        num_leg_states = self._num_leg_states_due()
        period = self._time.advance()
        if period is None:
            return []
        lost = self._halt_if_expired(period[0])
        news = self._body.advance(self._motion.shifted(-self._encoders.bias), *period)
        messages = self._states()
        if self._num_leg_states_due() > num_leg_states:
            messages += [self._leg_state(), *self._events(self._strokes.look(self._true_actuators()))]
        messages += self._events(news, Severity.ERROR) + ([self._leg_state()] if news else [])
        return messages + self._events(lost)

    def set_joint_target(self, target: JointTarget) -> list[Message]:
        """Sets the joints off towards a target, from where they are; the steps that follow carry it out.

        Raises:
            RefusedError: the target cannot be reached, and the robot goes on with what it was doing; or it was stopped
                a moment ago, and the target was still under way.
        """
        self._refuse_after_stop()
        q = resolve_joints(target, self._motion.q_end, self._lower, self._upper)
        if not self._vigil.renew(target, self._time.stamp_ns):
            self._set_off(q, self._slides.q_end, target.duration_s)
            self._vigil.begin(target, self._time.stamp_ns)
        return []

    def set_actuator_target(self, target: ActuatorTarget) -> list[Message]:
        """Sets the actuators off towards a target, in the same way; the core links slide as they must.

        Raises:
            RefusedError: the target cannot be reached; the robot goes on with what it was doing.
        """
        self._refuse_after_stop()
        before = self._motion.q_end, self._slides.q_end
        q, slides = resolve_actuators(target, *before, self._lower, self._upper, self._actuators)
        self._set_off(q, slides, target.duration_s)
        return []

    def stop(self, stop: Stop) -> list[Message]:
        """Halts every joint where it is; magnets are left alone. Targets that are still under way will be refused."""
        self._halt()
        self._deaf_until_ns = self._time.stamp_ns + _DEAF_NS
        return [*self._events([f"the robot is {stop.reason}"])]

    def set_fixed_foot(self, target: LegTarget) -> list[Message]:
        """Makes a foot the fixed one."""
        news = self._body.change_foot(target.foot, self._time.stamp_ns)
        return [self._leg_state(), *self._events(news, Severity.ERROR)]

    def control(self, control: SimControl) -> list[Message]:
        """Pauses, resumes, steps, resets or seeds the simulation, or changes its pace.

        Raises:
            RefusedError: see `SimTime.control`; a seed that is negative.
        """
        if control.seed is not None and control.seed < 0:
            raise RefusedError(f"seed is {control.seed}, must not be negative")
        self._time.control(control)
        if control.seed is not None:
            self._reseed(control.seed)
        if control.action is not SimAction.RESET:
            return [self._clock()]
        self._body.reset()
        self._stop(np.zeros(2))
        text = "the robot is back at its initial place and posture"
        return [*self._states(), self._leg_state(), *self._events([text], Severity.INFO)]

    def close(self) -> None:
        """Ends the physics engine."""
        self._body.close()

    def _reseed(self, seed: int) -> None:
        """New noise, and new biases: the joints stop where they are, which the drives now know as another place."""
        encoder_rng, slip_rng = generators(seed)
        self._encoders = Encoders(self._config.encoders, encoder_rng)
        self._slip.reseed(slip_rng)
        self._halt()

    def _halt(self) -> None:
        self._stop(self._slides.at(self._time.stamp_ns)[0])

    def _halt_if_expired(self, stamp_ns: int) -> list[str]:
        if not self._vigil.is_over(stamp_ns):
            return []
        self._vigil.end()
        if self._motion.is_over(stamp_ns):
            return []
        self._halt()
        return ["the joint target was not renewed in time: the robot is stopped"]

    def _refuse_after_stop(self) -> None:
        if self._time.stamp_ns < self._deaf_until_ns:
            raise RefusedError(f"the robot was stopped less than {_DEAF_NS / 1e9:g} s ago")

    def _stop(self, slides: Float) -> None:
        q = np.clip(self._body.resting_q() + self._encoders.bias, self._lower, self._upper)
        self._motion = JointMotion(q, q)
        self._slides = JointMotion(slides, slides)
        self._vigil.end()

    def _set_off(self, q: Float, slides: Float, duration_s: float | None) -> None:
        now_ns = self._time.stamp_ns
        q_now, slides_now = self._motion.at(now_ns)[0], self._slides.at(now_ns)[0]
        slide_s = float(np.max(np.abs(slides - slides_now))) / _MAX_SLIDE_MPS
        self._vigil.end()
        self._motion = plan_motion(q_now, q, now_ns, self._max_velocity, max(duration_s or 0.0, slide_s), self._ramp_s)
        self._slides = JointMotion(slides_now, slides, now_ns, self._motion.duration_ns, self._motion.ramp_ns)

    def _states(self) -> list[Message]:
        q, dq = self._encoders.read(self._body.q), self._body.dq
        slides, dslides = self._slides.at(self._time.stamp_ns)
        positions, velocities = actuator_motion(q, dq, slides, dslides, self._actuators)
        T_parent_child = np.vstack([self._tree.edges(self._body.poses()), self._body.T_world_foot.xyz_quat_xyzw])
        return [
            self._stamped(JointState, self._tree.root, q=q, dq=dq, effort=self._body.effort),
            self._stamped(ActuatorState, self._tree.root, positions=positions, velocities=velocities),
            self._stamped(
                Transforms,
                WORLD_FRAME,
                parents=(*self._tree.parents, WORLD_FRAME),
                children=(*self._tree.children, FIXED_FOOT_FRAME),
                T_parent_child=T_parent_child,
            ),
            self._clock(),
        ]

    def _true_actuators(self) -> Float:
        return actuators_from_joints(self._body.q, self._slides.at(self._time.stamp_ns)[0], self._actuators)

    def _clock(self) -> Clock:
        return self._stamped(Clock, "", real_time_factor=self._time.real_time_factor)

    def _leg_state(self) -> LegState:
        state = self._body.foot_state()
        return self._stamped(
            LegState,
            WORLD_FRAME,
            fixed_foot=state.fixed_foot,
            T_world_foot=state.T_world_foot.xyz_quat_xyzw,
            has_contact=state.has_contact,
            holding=state.holding,
            wrench=state.wrench,
            load_n=state.load_n,
            margin=state.margin,
        )

    def _num_leg_states_due(self) -> int:
        return int(self._time.num_periods * self._config.leg_state_rate_hz / self._config.rate_hz)

    def _events(self, texts: Iterable[str], severity: Severity = Severity.WARNING) -> list[Event]:
        return [self._stamped(Event, "", source="sim", severity=severity, text=text) for text in texts]

    def _stamped(self, kind: type[M], frame: str, **fields: Any) -> M:
        return self._numbering.stamped(kind, self._time.stamp_ns, frame, **fields)
