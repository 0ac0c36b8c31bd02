"""The robot's postures over the last minute, as its encoders read them, and where the sensor is mounted on it."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from services.mapper.state import ReadingsState
from shared.errors import InputFileError
from shared.geometry import SE3, Float
from shared.messaging.messages import Foot, JointState
from shared.robot.description import UrdfModel
from shared.robot.kinematics import HYRECRO, LINKS, link_matrices

_KEPT_NS = 60_000_000_000
"""A sensor that was away for so long, being started again, is still found by the way since its last scan."""
_MAX_READINGS = 100_000
"""Eight times as many as come in all that time: stamps may be a nanosecond apart."""
_MAX_GAP_NS = 50_000_000
"""Before the first and after the last reading a posture is taken to last so long."""


@dataclass(frozen=True, slots=True)
class Mount:
    """The moving link that carries a frame, by its number in LINKS, and where on it."""

    link: int
    T_link_frame: SE3


class Postures:
    """Joint readings and the links' poses that follow from them.

    mount: of the sensor; None while it is not known.
    """

    def __init__(self) -> None:
        self.mount: Mount | None = None
        self._stamps_ns: list[int] = []
        self._q: list[Float] = []

    def add(self, joints: JointState) -> None:
        """Takes a reading; one that is not later than the last begins anew."""
        if self._stamps_ns and joints.stamp_ns <= self._stamps_ns[-1]:
            self._stamps_ns, self._q = [], []
        self._stamps_ns.append(joints.stamp_ns)
        self._q.append(joints.q)
        if joints.stamp_ns - self._stamps_ns[0] > 2 * _KEPT_NS or len(self._q) > _MAX_READINGS:
            kept = max(bisect_left(self._stamps_ns, joints.stamp_ns - _KEPT_NS), len(self._q) - _MAX_READINGS // 2)
            del self._stamps_ns[:kept], self._q[:kept]

    def snapshot(self, since_ns: int) -> ReadingsState:
        """The readings since then, and the one before."""
        first = max(bisect_left(self._stamps_ns, since_ns) - 1, 0)
        stamps_ns, q = np.array(self._stamps_ns[first:], dtype=np.int64), np.array(self._q[first:]).reshape(-1, 8)
        return ReadingsState(stamps_ns=stamps_ns, q=q)

    def restore(self, state: ReadingsState) -> None:
        """Takes readings over; between the last of them and the next, nothing is known, and both ends are."""
        self._stamps_ns, self._q = state.stamps_ns.tolist(), list(state.q)

    def knows(self, start_ns: int, end_ns: int) -> bool:
        """Whether the mount is known, and there are readings over all of this time."""
        return self.mount is not None and self.has_reading(start_ns) and self.has_reading(end_ns)

    def has_reading(self, stamp_ns: int) -> bool:
        """Whether the posture at this time is known."""
        stamps = self._stamps_ns
        return bool(stamps) and stamps[0] <= stamp_ns + _MAX_GAP_NS and stamp_ns - _MAX_GAP_NS <= stamps[-1]

    def stamps_between(self, start_ns: int, end_ns: int) -> list[int]:
        """Those of readings after the start and before the end."""
        stamps = self._stamps_ns
        return stamps[bisect_left(stamps, start_ns + 1) : bisect_left(stamps, end_ns)]

    def links(self, stamps_ns: list[int]) -> Float:
        """T_footA_link (K, 9, 4, 4) of `LINKS` at each time, joints linear between two readings."""
        first = max(bisect_left(self._stamps_ns, stamps_ns[0]) - 1, 0)
        last = bisect_left(self._stamps_ns, stamps_ns[-1]) + 1
        known, q = np.array(self._stamps_ns[first:last], dtype=np.float64), np.array(self._q[first:last])
        at = np.array(stamps_ns, dtype=np.float64)
        return link_matrices(np.column_stack([np.interp(at, known, column) for column in q.T]))

    def feet(self, links: Float) -> dict[Foot, Float]:
        """T_footA_foot (K, 4, 4) of each foot's plate, for links (K, 9, 4, 4)."""
        T_link_b = HYRECRO.T_link_foot(Foot.B).matrix
        T_link_a = HYRECRO.T_link_foot(Foot.A).matrix
        return {Foot.A: links[:, 0] @ T_link_a, Foot.B: links[:, -1] @ T_link_b}

    def sensor(self, links: Float) -> Float:
        """T_footA_sensor (K, 4, 4) for links (K, 9, 4, 4)."""
        assert self.mount is not None
        poses: Float = links[:, self.mount.link] @ self.mount.T_link_frame.matrix
        return poses


def mount_of(model: UrdfModel, frame: str) -> Mount:
    """Where a robot carries a frame, such as a sensor's.

    Raises:
        InputFileError: the frame is not fixed to any of the moving links.
    """
    by_child = {joint.child: joint for joint in model.joints}
    T_link_frame, link = SE3.identity(), frame
    while link not in LINKS:
        joint = by_child.get(link)
        if joint is None:
            raise InputFileError(f"robot: the frame '{frame}' is not fixed to any of {', '.join(LINKS)}")
        T_link_frame, link = joint.T_parent_child() @ T_link_frame, joint.parent
    return Mount(LINKS.index(link), T_link_frame)
