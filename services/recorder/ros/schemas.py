"""The ROS 2 types a recording uses: their registry, their schema text, and the small messages others are made of.

The project's own types stand here as .msg text in package `hyrecro_msgs`. A float that may be unknown is NaN then.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from shared.messaging.messages import Measurement

NS_PER_S = 1_000_000_000

OWN_PACKAGE = "hyrecro_msgs"

OWN_DEFINITIONS: dict[str, str] = {
    "hyrecro_msgs/msg/LegState": """\
std_msgs/Header header
int64 seq
string fixed_foot
geometry_msgs/Pose foot_pose
bool is_contact_known
bool has_contact
bool is_holding_known
string[] holding
geometry_msgs/Wrench wrench
float64 load_n
float64 margin
""",
    "hyrecro_msgs/msg/FootStatus": """\
std_msgs/Header header
int64 seq
string foot
string phase
float64 progress
string text
bool is_goal_known
geometry_msgs/Pose goal
float64 duration_s
float64 margin
""",
    "hyrecro_msgs/msg/MapStatus": """\
std_msgs/Header header
int64 seq
int64 scan_seq
string method
string prior
bool is_tracking
bool is_suspect
float64 registration_ms
float64 lag_ms
int64 num_iterations
int64 num_points
int64 num_inliers
float64 score
float64 fitness
string[] degenerate_axes
int64 num_map_points
int64 num_scans_missed
int64 num_lost_scans
float64 leg_slip_m
""",
    "hyrecro_msgs/msg/Plane": """\
int64 id
float64[4] coefficients
int64 num_inliers
geometry_msgs/Polygon outline
std_msgs/ColorRGBA color
""",
    "hyrecro_msgs/msg/PlaneMap": """\
std_msgs/Header header
int64 seq
hyrecro_msgs/Plane[] planes
""",
    "hyrecro_msgs/msg/TrackingMetrics": """\
std_msgs/Header header
int64 seq
int64 num_poses
float64 ate_rmse_m
float64 rpe_rmse_m
float64 last_error_m
float64 last_error_rad
float64 rpe_rmse_rad
float64 drift_m
float64 map_accuracy_mean_m
float64 map_accuracy_p95_m
int64 num_map_points
""",
    "hyrecro_msgs/msg/ChannelRecord": """\
string key
int64 num_received
int64 num_written
int64 num_lost_on_bus
int64 num_lost_to_disk
int64 num_published
""",
    "hyrecro_msgs/msg/RecorderStatus": """\
std_msgs/Header header
int64 seq
bool is_recording
string path
int64 num_files
int64 num_bytes
int64 free_bytes
string text
hyrecro_msgs/ChannelRecord[] channels
""",
}


@functools.cache
def typestore() -> Typestore:
    """ROS 2 Jazzy's message types and the project's own; built once, on first use (0.2 s)."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for ros_type, text in OWN_DEFINITIONS.items():
        store.register(get_types_from_msg(text, ros_type))
    return store


@functools.cache
def schema_text(ros_type: str) -> str:
    """The definition of `ros_type` and of all it contains, as MCAP's `ros2msg` schema encoding wants it.

    Raises:
        KeyError: the type is neither ROS 2 Jazzy's nor the project's own.
    Source: https://mcap.dev/spec/registry#ros2msg
    """
    store = typestore()
    if ros_type not in store.fielddefs:
        raise KeyError(f"{ros_type}: no such ROS 2 type; own types are {', '.join(OWN_DEFINITIONS)}")
    return str(store.generate_msgdef(ros_type, ros_version=2)[0])


def prepare(ros_type: str) -> None:
    """Does now what the first message of a type would otherwise wait for: its schema's text, its serializer."""
    schema_text(ros_type)
    typestore().get_msgdef(ros_type)


def new(ros_type: str, **fields: object) -> Any:
    """A message of `ros_type` with all its fields."""
    return typestore().types[ros_type](**fields)


def time(stamp_ns: int) -> Any:
    """builtin_interfaces/Time."""
    return new("builtin_interfaces/msg/Time", sec=stamp_ns // NS_PER_S, nanosec=stamp_ns % NS_PER_S)


def header(stamp_ns: int, frame: str) -> Any:
    """std_msgs/Header."""
    return new("std_msgs/msg/Header", stamp=time(stamp_ns), frame_id=frame)


def vector(xyz: list[float]) -> Any:
    """geometry_msgs/Vector3."""
    return new("geometry_msgs/msg/Vector3", x=xyz[0], y=xyz[1], z=xyz[2])


def quaternion(xyzw: list[float]) -> Any:
    """geometry_msgs/Quaternion."""
    return new("geometry_msgs/msg/Quaternion", x=xyzw[0], y=xyzw[1], z=xyzw[2], w=xyzw[3])


def pose(xyz_quat_xyzw: NDArray[np.float64]) -> Any:
    """geometry_msgs/Pose of (7,): x y z in metres, quaternion x y z w."""
    x, y, z, *xyzw = xyz_quat_xyzw.tolist()
    point = new("geometry_msgs/msg/Point", x=x, y=y, z=z)
    return new("geometry_msgs/msg/Pose", position=point, orientation=quaternion(xyzw))


def wrench(force_moment: NDArray[np.float64]) -> Any:
    """geometry_msgs/Wrench of (6,): force in N, moment in Nm."""
    values = force_moment.tolist()
    return new("geometry_msgs/msg/Wrench", force=vector(values[:3]), torque=vector(values[3:]))


def string(text: str) -> Any:
    """std_msgs/String."""
    return new("std_msgs/msg/String", data=text)


def own(message: Measurement, stamp_ns: int, **differing: object) -> Any:
    """The project's own type of the same name as the message: same-named fields are copied, `differing` replaces."""
    ros_type = f"{OWN_PACKAGE}/msg/{type(message).__name__}"
    _, fields = typestore().fielddefs[ros_type]
    copied = {name: getattr(message, name) for name, _ in fields if name != "header" and name not in differing}
    return new(ros_type, header=header(stamp_ns, message.frame), **copied, **differing)
