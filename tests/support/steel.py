"""Small structures for tests."""

from shared.geometry import SE3
from shared.runtime.config import CONFIGS_DIR
from shared.solids import Box
from shared.world.files import load_structure
from shared.world.structure import Member, Structure

ORIGINAL = load_structure(CONFIGS_DIR / "structures" / "original.yaml")
BEAM = Member("beam", Box((2.0, 0.2, 0.2)), SE3.trans(z_m=-0.1))
"""Along x; its top is at z = 0."""


def structure(*members: Member) -> Structure:
    return Structure("small", members, None)
