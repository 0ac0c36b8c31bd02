"""What the mapper must know to go on in its map after it was killed.

Two parts: where it is, which is small and kept before each pose is said, and the map, which is large and may be older.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from shared.messaging.fields import Array
from shared.messaging.messages import Foot, Message

Matrix = Annotated[NDArray[np.float64], Array("float64", (4, 4))]
Matrices = Annotated[NDArray[np.float64], Array("float64", ("K", 4, 4))]
Integers = Annotated[NDArray[np.int64], Array("int64", ("K",))]
Counts = Annotated[NDArray[np.int32], Array("int32", ("K",))]
Lists = Annotated[NDArray[np.int32], Array("int32", ("L",))]
Planes = Annotated[NDArray[np.float64], Array("float64", ("K", 4))]
Places = Annotated[NDArray[np.float64], Array("float64", ("K", 3))]
Moments = Annotated[NDArray[np.float64], Array("float64", ("K", 10))]
Postures = Annotated[NDArray[np.float64], Array("float64", ("K", 8))]
Sigmas = Annotated[NDArray[np.float64], Array("float64", ("R",))]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReadingsState(Message):
    """The last readings of the encoders."""

    stamps_ns: Integers
    q: Postures


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LegsState(Message):
    """From when on (K,) which foot was fixed, and where in the odometry's frame. seen_ns: the last leg state.

    since_ns: of what was before, nothing is known.
    """

    stamps_ns: Integers
    feet: tuple[Foot, ...]
    T_odom_foot: Matrices
    seen_ns: int
    since_ns: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotionState(Message):
    """What the way from the last scan, taken at last_ns, follows from."""

    last_ns: int | None
    readings: ReadingsState
    legs: LegsState


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackState(Message):
    """Where the sensor is believed to be, was tracked last, and was first. num_lost: scans since it was tracked."""

    T_map_sensor: Matrix
    T_map_tracked: Matrix
    T_map_first: Matrix
    num_lost: int
    num_lost_scans: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseState(Message):
    """Where the mapper is at the last scan, and what it has said.

    num_sent (4,): odometries, statuses, clouds, plane maps. scans (3,): the sensor's last number, or -1, and how many
    were received and missed.
    """

    stamp_ns: int
    map_period: int
    num_sent: Integers
    scans: Annotated[NDArray[np.int64], Array("int64", (3,))]
    track: TrackState
    motion: MotionState


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VoxelsState(Message):
    """A `VoxelMap`: the voxels' keys (K,), sums of points (K, 3), numbers of points (K,)."""

    keys: Integers
    sums_m: Places
    counts: Counts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TableState(Message):
    """A `VoxelTable` of planes: the slots in use alone, their lists one after the other. num_slots: of the table."""

    keys: Integers
    lists: Lists
    hits: Counts
    num_slots: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanesState(Message):
    """A `PlaneMatcher`: its patches with their moments, where they are, and what it has learnt."""

    planes: Planes
    origins_m: Places
    moments: Moments
    num_points: Integers
    narrow: TableState
    wide: TableState
    voxel_m: float
    sigma_by_range_m: Sigmas
    num_scans: int
    usual_agreement: float
    usual_gain: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointsState(Message):
    """A `PointMatcher`: its target's points_m (K, 3), the voxels they come from where there are some.

    near_m (1, 3): where the last keyframe was taken.
    """

    points_m: Places
    voxels: VoxelsState | None
    near_m: Annotated[NDArray[np.float64], Array("float64", ("P", 3))]
    novelty: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetState(Message):
    """What scans are aligned to, by the one or the other kind of matcher."""

    planes: PlanesState | None = None
    points: PointsState | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapState(Message):
    """The map when it was last kept, at stamp_ns: what scans are aligned to, and its cloud."""

    stamp_ns: int
    target: TargetState
    cloud: VoxelsState
