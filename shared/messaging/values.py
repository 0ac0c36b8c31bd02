"""What the fields of messages hold: arrays by shape and unit, names in their order, choices."""

from __future__ import annotations

import enum
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from shared.messaging.fields import MAX_NAME_CHARS, Array, Text

Name = Annotated[str, Text(MAX_NAME_CHARS)]
"""Of a service, a key, a frame, a joint: such as are kept, one by one, by whoever hears them."""

Joints = Annotated[NDArray[np.float64], Array("float64", (8,), is_inline=True)]
"""Values of q1..q8 in order: radians, and metres for q2 and q7."""

Pose = Annotated[NDArray[np.float64], Array("float64", (7,), is_inline=True, is_pose=True)]
Poses = Annotated[NDArray[np.float64], Array("float64", ("N", 7), is_pose=True)]
Actuators = Annotated[NDArray[np.float64], Array("float64", (10,), is_inline=True)]
"""Values of the ten actuators in the order of `ACTUATOR_NAMES`: metres, and radians for the two hip drives."""

Vector = Annotated[NDArray[np.float64], Array("float64", (3,), is_inline=True)]
Wrench = Annotated[NDArray[np.float64], Array("float64", (6,), is_inline=True)]
"""Force in N, then moment in Nm."""
Coefficients = Annotated[NDArray[np.float64], Array("float64", (4,), is_inline=True)]
"""Of a plane: unit normal, then offset in metres."""
NamedValues = Annotated[NDArray[np.float64], Array("float64", ("J",), is_inline=True)]
Points = Annotated[NDArray[np.float32], Array("float32", ("N", 3))]
PerPointFloat = Annotated[NDArray[np.float32], Array("float32", ("N",))]
PerPointTime = Annotated[NDArray[np.uint32], Array("uint32", ("N",))]
PerPointRing = Annotated[NDArray[np.uint16], Array("uint16", ("N",))]
PerPointNumber = Annotated[NDArray[np.int32], Array("int32", ("N",))]
Pixels = Annotated[NDArray[np.uint16], Array("uint16", ("N",))]
Covariance = Annotated[NDArray[np.float64], Array("float64", (6, 6), is_inline=True)]

MAX_SERVICES = 1000
"""That anybody follows; whoever invents the names of more is not heard."""
MAX_STAMP_NS = 2**31 * 10**9 - 1
"""ROS 2 counts the seconds of a time in an int32 (builtin_interfaces/Time)."""
MAX_COUNT = 2**63 - 1
"""Counters stay there: losses are counted by the numbers that others send."""
MAX_PIXELS = 2**16
"""Of an image's side, and of what is measured in its pixels."""
MAX_PLACE_M = 1e6
"""Beyond any structure: what a command says to be farther is a wrong unit."""
MAX_SPEED = 1e6
"""Of a replay: recorded seconds a second."""
JOINT_NAMES = ("q1", "q2", "q3", "q4", "q5", "q6", "q7", "q8")
ACTUATOR_NAMES = ("a1_l", "a1_r", "a2_l", "a2_r", "th_a", "th_b", "b2_l", "b2_r", "b1_l", "b1_r")
"""From foot A to foot B: the left and right piston of each leg's module 1 (at the foot) and 2 (at the hip), the hip."""


class Foot(enum.Enum):
    """One of the robot's two magnetic feet."""

    A = "A"
    B = "B"

    @property
    def other(self) -> Foot:
        """The foot at the other end."""
        return Foot.B if self is Foot.A else Foot.A


class Severity(enum.Enum):
    """How much an event matters, as in ROS 2's rcl_interfaces/Log."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class FootPhase(enum.Enum):
    """Where a step of the free foot stands; the last four end it."""

    PLANNING = "planning"
    LIFT = "lift"
    TRANSFER = "transfer"
    LANDING = "landing"
    DONE = "done"
    REFUSED = "refused"
    FAILED = "failed"
    STOPPED = "stopped"


class SimAction(enum.Enum):
    """What can be asked of simulated time."""

    PAUSE = "pause"
    RESUME = "resume"
    STEP = "step"
    RESET = "reset"


class RecorderAction(enum.Enum):
    """What can be asked of the recorder."""

    START = "start"
    STOP = "stop"


class ReplayAction(enum.Enum):
    """What can be asked of a replay."""

    PAUSE = "pause"
    RESUME = "resume"
    STEP = "step"
