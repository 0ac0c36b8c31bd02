"""What the evaluator must know to go on scoring the same run: above all where the map was laid on the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from shared.messaging.fields import Array
from shared.messaging.messages import Message

Matrix = Annotated[NDArray[np.float64], Array("float64", (4, 4))]
Sums = Annotated[NDArray[np.float64], Array("float64", (5,))]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairState(Message):
    """An estimated pose in the map and the true one in the world."""

    T_map_lidar: Matrix
    T_world_lidar: Matrix


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ComparisonState(Message):
    """poses, steps (5,): number, then sums of m, m^2 and rad^2, then the largest in m."""

    T_world_map: Matrix
    first: PairState
    previous: PairState
    poses: Sums
    steps: Sums
    pairs_ok: int
    path_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EvaluatorState(Message):
    """last_odometry_ns, last_odometry_seq: of the newest estimate. world_frame, map_frame: that the link connects."""

    comparison: ComparisonState
    world_frame: str
    map_frame: str
    last_true_ns: int
    last_odometry_ns: int
    last_odometry_seq: int
    due_ns: int
    num_metrics: int
    num_links: int
