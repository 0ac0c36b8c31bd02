"""What the free foot's sole would find if it became the fixed one now."""

from __future__ import annotations

from shared.climbing.steel import SoleContact, SteelSurface
from shared.errors import MessageError
from shared.messaging.frames import FrameTree
from shared.messaging.messages import Foot, Transforms
from shared.robot.kinematics import FOOT_LINKS, HYRECRO


def contact_of(foot: Foot, transforms: Transforms | None, steel: SteelSurface) -> SoleContact | None:
    """What is under the sole of a foot; None where the transforms do not say where it is."""
    if transforms is None:
        return None
    try:
        T_world_link = FrameTree(transforms).T_root(FOOT_LINKS[foot])
    except MessageError:
        return None
    return steel.under_sole(T_world_link @ HYRECRO.T_link_foot(foot))
