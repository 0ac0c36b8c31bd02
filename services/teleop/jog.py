"""Joint targets of a person's hand: sent when a slider moves, renewed while the robot is on its way."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from shared.geometry import Float
from shared.messaging.messages import JOINT_NAMES, JointState, JointTarget

_GRACE_S = 0.5
"""A target counts as under way for so long after it should have been reached: drives lag, ramps take time."""
_MIN_DURATION_S = 1e-3


class Jog:
    """Where the joints shall go that were moved and have not arrived yet.

    max_velocity: (8,) of the joints, rad/s and m/s. valid_s: how long a target holds without being renewed.
    """

    def __init__(self, max_velocity: Float, valid_s: float) -> None:
        self._max_velocity = max_velocity
        self._valid_s = valid_s
        self._wants: dict[int, float] = {}
        self._target: JointTarget | None = None
        self._until_ns = 0

    @property
    def joints(self) -> frozenset[int]:
        """Which joints (0..7) are on their way."""
        return frozenset(self._wants)

    def move(self, wants: Mapping[int, float]) -> None:
        """Sets more joints off, or the same ones to another place: radians, metres."""
        self._wants.update(wants)
        self._target = None

    def cancel(self) -> None:
        """Forgets where the joints should go."""
        self._wants.clear()
        self._target = None

    def next_target(self, state: JointState, speed_share: float, pace: float) -> JointTarget | None:
        """The target that is due, new or the same again, which renews it; None where nothing is on its way.

        pace: seconds of simulated time a second. The faster it runs, the longer a target must hold in simulated time.
        """
        if self._wants and self._target is None:
            self._target = self._new_target(state, speed_share, pace)
        elif self._wants and state.stamp_ns >= self._until_ns:
            self.cancel()
        return self._target

    def _new_target(self, state: JointState, speed_share: float, pace: float) -> JointTarget:
        joints = sorted(self._wants)
        q = np.array([self._wants[joint] for joint in joints])
        needed_s = float(np.max(np.abs(q - state.q[joints]) / self._max_velocity[joints]))
        duration_s = max(needed_s / speed_share, _MIN_DURATION_S)
        self._until_ns = state.stamp_ns + round((duration_s + _GRACE_S) * 1e9)
        names = tuple(JOINT_NAMES[joint] for joint in joints)
        return JointTarget(q=q, names=names, duration_s=duration_s, valid_s=self._valid_s * max(1.0, pace))
