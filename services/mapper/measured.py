"""A scan before and after it is registered."""

from __future__ import annotations

from dataclasses import dataclass

from services.mapper.registration import Points as Points
from shared.geometry import SE3


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """points_m: of a scan as it was registered, filtered and straightened (N, 3), in the sensor's frame.

    T_map_sensor: where they were found, or predicted if not `is_tracked`; of a straightened scan in its middle.
    """

    points_m: Points
    T_map_sensor: SE3
    is_tracked: bool


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What a sensor measured: points_m (N, 3) in `frame`, all as if taken at `taken_ns`.

    seq: of the message. started_ns, received_ns: when work on it began and when it came, on the wall's clock.
    """

    points_m: Points
    taken_ns: int
    seq: int
    frame: str
    started_ns: int
    received_ns: int
