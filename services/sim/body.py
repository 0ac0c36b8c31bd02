"""What moves in the simulation: the interface of its two modes, and what both say about the feet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.sim.motion import JointMotion
from services.sim.state import BodyState
from shared.geometry import SE3
from shared.messaging.messages import Foot

Joints = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FootState:
    """The fixed foot's place and hold, as `LegState` defines them; None = not simulated."""

    fixed_foot: Foot
    T_world_foot: SE3
    has_contact: bool
    holding: tuple[Foot, ...]
    wrench: NDArray[np.float64] | None = None
    load_n: float | None = None
    margin: float | None = None


def pull_n(wrench: NDArray[np.float64]) -> float:
    """How hard the magnet of a foot is pulled at, of the wrench (6,) that the steel exerts on it."""
    return max(0.0, -float(wrench[2]))


class Body(Protocol):
    """A robot on a structure whose joints follow a commanded motion.

    links: names in the order of `poses`. q, dq: true positions and velocities (8,). effort: Nm and N, None where there
    are no forces.
    """

    links: tuple[str, ...]
    q: Joints
    dq: Joints
    effort: Joints | None

    @property
    def T_world_foot(self) -> SE3:
        """Where the plate of the fixed foot is."""

    def resting_q(self) -> Joints:
        """Where the joints (8,) come to rest if they brake as hard as they may from now on."""

    def advance(self, motion: JointMotion, from_ns: int, to_ns: int) -> list[str]:
        """Goes on to a later time. Returns what happened that people should read."""

    def change_foot(self, foot: Foot, stamp_ns: int) -> list[str]:
        """Makes a foot the fixed one. Returns what happened that people should read."""

    def foot_state(self) -> FootState:
        """How the fixed foot stands."""

    def poses(self) -> NDArray[np.float64]:
        """T_world_link (L, 7) of every link."""

    def reset(self) -> None:
        """Back to the initial place and posture, at rest."""

    def snapshot(self) -> BodyState:
        """What `restore` needs."""

    def restore(self, state: BodyState, stamp_ns: int) -> None:
        """Takes a place, a posture and holds over, at rest."""

    def close(self) -> None:
        """Ends the engine; nothing else may be called afterwards."""
