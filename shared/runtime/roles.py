"""Who takes part on a secure bus: a role has one credential, and the router's access control says what it may."""

from __future__ import annotations

from shared.messaging.channels import SENSOR_CHANNELS

OPERATOR, VIEWER = "operator", "viewer"

ROLES: tuple[str, ...] = (
    OPERATOR,
    VIEWER,
    "sim",
    *SENSOR_CHANNELS,
    "mapper",
    "planner",
    "evaluator",
    "recorder",
    "player",
    "teleop",
    "supervisor",
)


def role_of(name: str) -> str:
    """The role of a service: its name; of a further sensor, such as `lidar_rear`, its kind."""
    kind = name.partition("_")[0]
    return kind if kind in SENSOR_CHANNELS else name
