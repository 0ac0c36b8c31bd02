"""Postures of the robot for tests: within its limits, and differences that do not count full turns."""

import numpy as np
from hypothesis import strategies as st

from shared.robot.limits import joint_bounds
from shared.robot.urdf import parse_urdf, read_urdf
from shared.runtime.config import CONFIGS_DIR

URDF = read_urdf(CONFIGS_DIR / "robot" / "hyrecro.urdf")
MODEL = parse_urdf(URDF, "hyrecro.urdf")
LOWER, UPPER = joint_bounds(MODEL)

postures = st.tuples(*(st.floats(low, high) for low, high in zip(LOWER, UPPER, strict=True)))


def random_postures(count, seed=1):
    return np.random.default_rng(seed).uniform(LOWER, UPPER, (count, 8))


def posture_distance(q, other):
    """The largest difference of a joint (...), angles up to full turns."""
    turn = np.array([2 * np.pi if joint not in (1, 6) else np.inf for joint in range(8)])
    difference = np.abs(np.asarray(q) - np.asarray(other))
    return np.minimum(difference, np.abs(turn - difference)).max(axis=-1)
