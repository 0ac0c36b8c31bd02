"""Where a foot can be put: target poses that are exactly flush with steel, or why there are none."""

from __future__ import annotations

import math

import numpy as np

from shared.climbing.steel import SoleContact, SteelSurface
from shared.errors import RefusedError
from shared.geometry import SE3
from shared.messaging.messages import FootTarget
from shared.robot.kinematics import HYRECRO

MAX_GAP_M = 0.5e-3
MAX_ANGLE_RAD = math.radians(0.5)
"""A sole within these holds with its magnet's whole force: what landings are accepted by."""

_SNAP_M = 5e-3
_SNAP_RAD = math.radians(2.0)
"""A target so near to flush is meant to be flush."""
_NUM_TURNS = 24
_NO_STEEL = "no flush steel there"


def footings(target: FootTarget, T_world_now: SE3, steel: SteelSurface) -> list[SE3]:
    """Poses T_world_foot of the plate's centre, flush with the steel that the target names.

    A pose gives one. A point gives one for each turn about its normal that keeps the whole sole over steel, those that
    turn the foot least against where it is now (T_world_now) first.

    Raises:
        RefusedError: no flush steel there.
    """
    if target.T_world_foot is not None:
        wanted = [SE3.from_xyz_quat_xyzw(target.T_world_foot)]
    else:
        assert target.point_m is not None
        assert target.normal is not None
        z = target.normal / np.linalg.norm(target.normal)
        upright = _least_turned(T_world_now, z, target.point_m + HYRECRO.sole_below_plate_m * z)
        turns = sorted(np.arange(_NUM_TURNS) * (2 * np.pi / _NUM_TURNS), key=lambda turn: 1 - math.cos(turn))
        wanted = [upright @ SE3.rot("z", turn) for turn in turns]
    flush = [pose for T in wanted if (pose := snapped(T, steel)) is not None]
    if not flush:
        raise RefusedError(f"{_NO_STEEL}: {_why_not(wanted, steel)}")
    return flush


def is_flush(T_world_foot: SE3, steel: SteelSurface) -> bool:
    """Whether a foot there stands on steel with its whole sole."""
    return steel.under_sole(T_world_foot).is_flush(MAX_GAP_M, MAX_ANGLE_RAD)


def stand_text(T_world_foot: SE3, steel: SteelSurface) -> str:
    """What is under a sole and how far from flush it is."""
    contact = steel.under_sole(T_world_foot)
    if not contact.coverage:
        return f"the nearest steel is {1e3 * steel.distance_m(T_world_foot):.0f} mm from the sole"
    return _contact_text(contact)


def _contact_text(contact: SoleContact) -> str:
    return (
        f"{', '.join(contact.members)} covers {100 * contact.coverage:.0f} % of the sole, {_mm(contact.gap_m)} mm "
        f"below it, {math.degrees(contact.angle_rad):.1f} deg off; all of it within {1e3 * MAX_GAP_M:g} mm and "
        f"{math.degrees(MAX_ANGLE_RAD):g} deg is needed"
    )


def _mm(length_m: float) -> str:
    return f"{round(1e3 * length_m, 1) + 0.0:.1f}"


def _least_turned(T_world_now: SE3, z: np.typing.NDArray[np.float64], xyz_m: np.typing.NDArray[np.float64]) -> SE3:
    """At xyz_m with z along the unit vector, x as near to where it is now as can be."""
    for axis in (0, 1):
        x = T_world_now.rotation[:, axis]
        x = x - (x @ z) * z
        if np.linalg.norm(x) > 0.5:  # one of two axes at right angles always is
            x /= np.linalg.norm(x)
            y = np.cross(z, x)
            columns = [x, y, z] if axis == 0 else [-y, x, z]
            return SE3(np.column_stack(columns), xyz_m)
    raise AssertionError("two axes at right angles cannot both be along z")


def snapped(T_world_foot: SE3, steel: SteelSurface) -> SE3 | None:
    """The flush pose that a target means; None where it is too far from flush or not wholly over steel."""
    flush = steel.flush_pose(T_world_foot)
    if flush is None or not is_flush(flush, steel):
        return None
    move = T_world_foot.inv() @ flush
    is_meant = np.linalg.norm(move.translation) <= _SNAP_M and move.angle_rad <= _SNAP_RAD
    return flush if is_meant else None


def _why_not(wanted: list[SE3], steel: SteelSurface) -> str:
    best = max(wanted, key=lambda T: steel.under_sole(T).coverage)
    return stand_text(best, steel)
