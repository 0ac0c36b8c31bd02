"""The shipped robot on a structure, simulated without a bus."""

from collections.abc import Iterator
from contextlib import contextmanager

from services.sim.climbing_sim import ClimbingSim
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import Event, Foot, Message, Transforms
from shared.robot.kinematics import FOOT_LINKS, HYRECRO
from shared.robot.urdf import parse_urdf, read_urdf
from shared.runtime.config import CONFIGS_DIR, SimConfig
from shared.world.files import load_structure
from shared.world.structure import Structure

URDF = read_urdf(CONFIGS_DIR / "robot" / "hyrecro.urdf")
MARK = read_urdf(CONFIGS_DIR / "robot" / "fixed_foot.urdf")
MODEL = parse_urdf(URDF, "hyrecro.urdf")
ORIGINAL = load_structure(CONFIGS_DIR / "structures" / "original.yaml")
NOTHING = Structure("nothing", (), None)


@contextmanager
def running(config: SimConfig | None = None, structure: Structure = NOTHING, seed: int = 0) -> Iterator[ClimbingSim]:
    sim = ClimbingSim(config or SimConfig(), URDF, structure, MARK, seed=seed)
    try:
        yield sim
    finally:
        sim.close()


def only(kind, messages):
    (message,) = (message for message in messages if type(message) is kind)
    return message


def events(messages: list[Message]) -> list[str]:
    return [message.text for message in messages if isinstance(message, Event)]


def T_world_foot(transforms: Transforms, foot: Foot) -> SE3:
    return FrameTree(transforms).T_root(FOOT_LINKS[foot]) @ HYRECRO.T_link_foot(foot)


def run(sim: ClimbingSim, seconds: float) -> list[Message]:
    """All messages of so many seconds of simulated time at 100 Hz."""
    return [message for _ in range(round(seconds * 100)) for message in sim.step()]


def last(kind: type, messages: list[Message]):
    return next(message for message in reversed(messages) if type(message) is kind)
