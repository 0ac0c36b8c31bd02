"""What the simulation must know to go on after it was killed. Motion is not among it: the robot goes on at rest."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from shared.messaging.fields import Array
from shared.messaging.messages import Foot, Message

Numbers = Annotated[NDArray[np.int64], Array("int64", ("K",))]
Posture = Annotated[NDArray[np.float64], Array("float64", (8,))]
Matrix = Annotated[NDArray[np.float64], Array("float64", (4, 4))]
"""Of a pose: as exact as it was, and quicker than a quaternion."""
Matrices = Annotated[NDArray[np.float64], Array("float64", ("N", 4, 4))]
Slides = Annotated[NDArray[np.float64], Array("float64", (2,))]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyState(Message):
    """q (8,): true joint positions. T_world_foot: the fixed foot's plate. holding: feet that are held at T_world_held.

    is_changing: both hold, and the fixed one is going to let go.
    """

    q: Posture
    fixed_foot: Foot
    T_world_foot: Matrix
    holding: tuple[Foot, ...]
    T_world_held: Matrices
    is_changing: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeState(Message):
    """num_periods have passed; factor: seconds of simulated time a second; num_single: steps still to do in a pause."""

    num_periods: int
    num_single: int
    is_paused: bool
    factor: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimState(Message):
    """num_sent (K,): messages of each kind, in the order of the simulation's own list. slides (2,): of the core links.

    bias (8,): of the encoders. encoder_rng, slip_rng: states of their generators, as `rng_text` writes them.
    deaf_until_ns: targets are refused until then.
    """

    time: TimeState
    body: BodyState
    num_sent: Numbers
    slides: Slides
    bias: Posture
    encoder_rng: str
    slip_rng: str
    deaf_until_ns: int


def rng_text(rng: np.random.Generator) -> str:
    """The state of a generator."""
    return json.dumps(rng.bit_generator.state)


def set_rng(rng: np.random.Generator, text: str) -> None:
    """Lets a generator go on from a state.

    Raises:
        ValueError: the text is no state of such a generator.
    """
    try:
        rng.bit_generator.state = json.loads(text)
    except (TypeError, KeyError) as error:
        raise ValueError(f"not the state of a generator: {error}") from error
