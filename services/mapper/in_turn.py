"""Gives a mapper what it takes in the order of measured time, so that its map follows from the data alone.

A scan that overtakes the encoders' readings of its own time would be predicted otherwise than one that does not. What
overtakes what is chance on a bus: a scan waits until the readings have come up to its end.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator

from services.mapper.mapper import Mapper
from shared.messaging.messages import DepthImage, Imu, JointState, LegState, LidarScan, Message
from shared.runtime.config import MapperConfig

_PATIENCE_NS = 200_000_000
"""Readings that are so far behind the last scan have ended: nothing waits for them."""
_MAX_EARLY = 10
"""So much waits for joints that are expected and have not come."""
_MAX_WAITING = 1000
"""Far more than readings are behind: what says to be of a time that does not come is taken all the same."""
_LEG, _SCAN = 0, 1
Add = Callable[[], list[Message]]


class InTurn:
    """Holds scans, and changes of foot, until each stream of readings they need is past them.

    Joints are needed always, an IMU where it is the prior. A stream that never came, or has ended, is not waited for.
    on_scan: called after each scan with what the mapper said of it.
    """

    def __init__(
        self, mapper: Mapper, config: MapperConfig, on_scan: Callable[[list[Message]], None] = lambda _: None
    ) -> None:
        self._mapper, self._on_scan = mapper, on_scan
        self._needed = (JointState, Imu) if config.prior == "imu" else (JointState,)
        self._reached_ns: dict[type[Message], int] = {}
        self._newest_ns = 0
        self._waiting: list[tuple[int, int, int, Add]] = []
        self._numbers = itertools.count()
        self._expects_joints = False

    def expect_joints(self) -> None:
        """The mapper goes on, and knew joints before: without them it would search for its first scan."""
        self._expects_joints = True

    def add_joints(self, joints: JointState) -> list[Message]:
        """Takes a reading of the encoders; returns what the mapper says of the scans that waited for it."""
        self._mapper.add_joints(joints)
        return self._reached(joints)

    def add_imu(self, imu: Imu) -> list[Message]:
        """Takes a reading of the sensor's IMU; returns as `add_joints`."""
        self._mapper.add_imu(imu)
        return self._reached(imu)

    def add_leg_state(self, legs: LegState) -> list[Message]:
        """Takes which foot is fixed: with the posture of that time it says where the foot stands."""
        self._put(legs.stamp_ns, _LEG, lambda: self._mapper.add_leg_state(legs))
        return list(self._due())

    def add_scan(self, scan: LidarScan, received_ns: int) -> list[Message]:
        """Takes a scan. See `Mapper.add_scan`."""
        end_ns = scan.stamp_ns + (int(scan.t_ns.max()) if len(scan.t_ns) else 0)
        return self._add(end_ns, lambda: self._mapper.add_scan(scan, received_ns))

    def add_image(self, image: DepthImage, received_ns: int) -> list[Message]:
        """Takes a depth image. See `Mapper.add_image`."""
        return self._add(image.stamp_ns, lambda: self._mapper.add_image(image, received_ns))

    def finish(self) -> list[Message]:
        """Nothing more comes: what still waits is taken now."""
        self._reached_ns.clear()
        return list(self._due())

    def _add(self, end_ns: int, add: Add) -> list[Message]:
        def noted() -> list[Message]:
            said = add()
            self._on_scan(said)
            return said

        self._newest_ns = end_ns
        self._put(end_ns, _SCAN, noted)
        return list(self._due())

    def _reached(self, reading: JointState | Imu) -> list[Message]:
        if type(reading) in self._needed:
            self._reached_ns[type(reading)] = reading.stamp_ns
        return list(self._due())

    def _put(self, stamp_ns: int, order: int, add: Add) -> None:
        heapq.heappush(self._waiting, (stamp_ns, order, next(self._numbers), add))

    def _due(self) -> Iterator[Message]:
        while self._waiting and self._is_known(self._waiting[0][0]):
            yield from heapq.heappop(self._waiting)[-1]()

    def _is_known(self, stamp_ns: int) -> bool:
        if self._expects_joints and JointState not in self._reached_ns and len(self._waiting) < _MAX_EARLY:
            return False
        if len(self._waiting) > _MAX_WAITING:
            return True
        has_ended_ns = self._newest_ns - _PATIENCE_NS
        return all(reached_ns >= stamp_ns or reached_ns < has_ended_ns for reached_ns in self._reached_ns.values())
