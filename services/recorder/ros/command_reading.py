"""Recorded commands as messages again: what a ROS type has no place for, such as a wanted duration, is lost."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from shared.messaging import messages as m
from shared.messaging.codec import decode_command

M = TypeVar("M", bound=m.Message)


def joint_target(ros_message: Any, _seq: int) -> m.JointTarget:
    """Without its duration. All eight names in their order are as none."""
    return m.JointTarget(q=ros_message.position, names=_names(ros_message, m.JOINT_NAMES))


def actuator_target(ros_message: Any, _seq: int) -> m.ActuatorTarget:
    """Without its duration. All ten names in their order are as none."""
    return m.ActuatorTarget(positions=ros_message.position, names=_names(ros_message, m.ACTUATOR_NAMES))


def leg_target(ros_message: Any, _seq: int) -> m.LegTarget:
    """The foot's letter."""
    return m.LegTarget(foot=m.Foot(ros_message.data))


def foot_target(ros_message: Any, _seq: int) -> m.FootTarget:
    """Without the foot that was meant; a point and its normal have become a pose."""
    p, q = ros_message.pose.position, ros_message.pose.orientation
    return m.FootTarget(T_world_foot=np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w]))


def stop(ros_message: Any, _seq: int) -> m.Stop:
    """With its reason."""
    return m.Stop(text=ros_message.data)


def control(message_type: type[M]) -> Callable[[Any, int], M]:
    """The reader of a command that was recorded as the JSON that could have been typed."""
    return lambda ros_message, _seq: decode_command(message_type, ros_message.data.encode())


def _names(ros_message: Any, all_names: tuple[str, ...]) -> tuple[str, ...] | None:
    names = tuple(ros_message.name)
    return None if names == all_names else names
