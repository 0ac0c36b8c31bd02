"""The sensor moves as joints and feet say: the fixed foot stands still, the rest follows from the joints.

At a change of foot both hold on, so the other foot stands where the joints put it, and the way goes on from there.
"""

from __future__ import annotations

import numpy as np

from services.mapper.postures import Postures
from services.mapper.state import LegsState
from shared.geometry import SE3
from shared.messaging.messages import Foot, LegState
from shared.motion import Motion

_MAX_CHANGES = 100
"""Of foot that are remembered: as many as the postures' seconds can hold many times over."""
_MAX_UNSEEN_NS = 250_000_000
"""A change of foot after a longer silence happened nobody knows when, and in what posture: leg states come 10 times a
second."""


class LegOdometry:
    """Odometry from encoders and foot states alone; it drifts by each foot's slip and the encoders' errors."""

    def __init__(self, postures: Postures) -> None:
        self._postures = postures
        self._holds: list[tuple[int, Foot, SE3]] = []
        self._seen_ns = self._since_ns = 0

    def add_leg_state(self, legs: LegState) -> None:
        """Takes which foot is fixed from then on. Where the foot stands in the world is not looked at."""
        if self._holds and legs.stamp_ns < self._holds[-1][0]:
            self._holds, self._since_ns = [], 0  # time went back: a new run
        seen_ns, self._seen_ns = self._seen_ns, legs.stamp_ns
        if not self._holds:
            self._holds = [(legs.stamp_ns, legs.fixed_foot, SE3.identity())]
        _, foot, T_odom_foot = self._holds[-1]
        if legs.fixed_foot is foot:
            return
        if legs.stamp_ns - seen_ns > _MAX_UNSEEN_NS:
            self._holds, self._since_ns = [(legs.stamp_ns, legs.fixed_foot, SE3.identity())], legs.stamp_ns
            return
        if not self._postures.has_reading(legs.stamp_ns):
            self._holds = [(legs.stamp_ns, legs.fixed_foot, SE3.identity())]
            return
        feet = self._postures.feet(self._postures.links([legs.stamp_ns]))
        T_foot_other = np.linalg.inv(feet[foot][0]) @ feet[legs.fixed_foot][0]
        self._holds.append((legs.stamp_ns, legs.fixed_foot, T_odom_foot @ SE3.projected(T_foot_other)))
        del self._holds[:-_MAX_CHANGES]

    def snapshot(self) -> LegsState:
        """Which foot was fixed when."""
        return LegsState(
            stamps_ns=np.array([stamp_ns for stamp_ns, _, _ in self._holds], dtype=np.int64),
            feet=tuple(foot for _, foot, _ in self._holds),
            T_odom_foot=np.array([pose.matrix for _, _, pose in self._holds]).reshape(-1, 4, 4),
            seen_ns=self._seen_ns,
            since_ns=self._since_ns,
        )

    def restore(self, state: LegsState) -> None:
        """Goes on from there.

        Raises:
            ValueError: it is no such state; nothing has changed.
        """
        poses = [SE3.from_matrix(matrix) for matrix in state.T_odom_foot]
        self._holds = list(zip(state.stamps_ns.tolist(), state.feet, poses, strict=True))
        self._seen_ns, self._since_ns = state.seen_ns, state.since_ns

    def motion(self, start_ns: int, end_ns: int) -> Motion | None:
        """T_odom_sensor over this time; None where joints or feet are not known."""
        if not self._knows(start_ns, end_ns):
            return None
        inner = self._postures.stamps_between(start_ns, end_ns)
        stamps_ns = [start_ns, *inner, *([end_ns] if end_ns > start_ns else [])]
        poses = [pose.xyz_quat_xyzw for pose in self._poses(stamps_ns)]
        return Motion(stamps_ns, np.array(poses)[:, np.newaxis])

    def step(self, start_ns: int, end_ns: int) -> SE3 | None:
        """From the postures at both times alone; the start may be after the end."""
        first_ns, last_ns = min(start_ns, end_ns), max(start_ns, end_ns)
        if not self._knows(first_ns, last_ns):
            return None
        first, last = self._poses([first_ns, last_ns])
        return first.inv() @ last if start_ns <= end_ns else last.inv() @ first

    def correct(self, stamp_ns: int, T_map_sensor: SE3 | None) -> None:
        """Legs learn nothing from scans."""

    def _knows(self, start_ns: int, end_ns: int) -> bool:
        is_seen = self._since_ns <= start_ns and bool(self._holds) and self._holds[0][0] <= end_ns
        return is_seen and self._postures.knows(start_ns, end_ns)

    def _poses(self, stamps_ns: list[int]) -> list[SE3]:
        """T_odom_sensor at these times, which do not go back, each from the foot that was fixed then."""
        links = self._postures.links(stamps_ns)
        feet, sensors = self._postures.feet(links), self._postures.sensor(links)
        poses = []
        for k, stamp_ns in enumerate(stamps_ns):
            held = [hold for hold in self._holds if hold[0] <= stamp_ns] or self._holds[:1]
            _, foot, T_odom_foot = held[-1]
            poses.append(T_odom_foot @ SE3.projected(np.linalg.inv(feet[foot][k]) @ sensors[k]))
        return poses
