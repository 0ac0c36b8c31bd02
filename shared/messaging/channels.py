"""The channel table: every key, what it carries, how it travels, how it is recorded. Nothing else names a key."""

from __future__ import annotations

import enum
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

from shared.messaging import messages as m

PREFIX = "hyrecro/"
ALIVE = PREFIX + "alive/*"
"""Liveliness tokens: one a service, held while it is ready."""
ROUTERS = PREFIX + "routers/*"
"""Liveliness tokens: one a router of `hyrecro router`."""
PUBLISHED = PREFIX + "published/**"
"""Liveliness tokens: one a key that somebody publishes, held as long."""


class Delivery(enum.Enum):
    """What an ordinary subscriber gets: the newest only, or every message."""

    LATEST = "latest"
    EVERY = "every"


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One line of the table.

    key: below `hyrecro/`. rate_hz: None = as it happens. is_command: people and programs send it to the robot, also as
    JSON, and a query on it is answered with accepted or the reason of refusal. is_kept: the publisher keeps the last
    message and answers queries with it, so that a late joiner gets it. is_large: it fills links and queues. topic,
    ros_type: where it stands in a recording. robot: the namespace of another robot, if it is not our own that speaks.
    """

    key: str
    message: type[m.Message]
    delivery: Delivery
    ros_type: str
    rate_hz: float | None = None
    is_command: bool = False
    is_kept: bool = False
    is_recorded: bool = True
    is_large: bool = False
    topic: str = ""
    robot: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "topic", self.topic or "/" + self.key)

    @property
    def key_expr(self) -> str:
        """The whole Zenoh key expression, without our own namespace."""
        return f"{self.robot}/{PREFIX}{self.key}" if self.robot else PREFIX + self.key

    @property
    def has_many_keys(self) -> bool:
        """Whether each service has a key of its own on it."""
        return "*" in self.key

    def of(self, service: str) -> Channel:
        """The concrete channel of one service, for a key that ends in `*`."""
        return replace(self, key=self.key.replace("*", service), topic=self.topic.replace("*", service))

    def every(self) -> Channel:
        """The channel for who needs each of its messages, not only the newest."""
        return replace(self, delivery=Delivery.EVERY)

    def of_robot(self, robot: str) -> Channel:
        """The channel of another robot, which has this namespace."""
        return replace(self, robot=robot)

    def of_sensor(self, sensor: str) -> Channel:
        """The channel of another sensor of the same kind: `lidar_rear/points` of `lidar/points`."""
        _, _, rest = self.key.partition("/")
        return replace(self, key=f"{sensor}/{rest}", topic=f"/{sensor}/{rest}")


LATEST, EVERY = Delivery.LATEST, Delivery.EVERY

JOINTS_TARGET = Channel(
    key="joints/target", message=m.JointTarget, delivery=EVERY, ros_type="sensor_msgs/msg/JointState", is_command=True
)
LEG_TARGET = Channel(
    key="leg/target", message=m.LegTarget, delivery=EVERY, ros_type="std_msgs/msg/String", is_command=True
)
ACTUATORS_TARGET = Channel(
    key="actuators/target",
    message=m.ActuatorTarget,
    delivery=EVERY,
    ros_type="sensor_msgs/msg/JointState",
    is_command=True,
)
FOOT_TARGET = Channel(
    key="foot/target",
    message=m.FootTarget,
    delivery=EVERY,
    ros_type="geometry_msgs/msg/PoseStamped",
    is_command=True,
)
ROBOT_STOP = Channel(key="robot/stop", message=m.Stop, delivery=EVERY, ros_type="std_msgs/msg/String", is_command=True)
SIM_CONTROL = Channel(
    key="sim/control", message=m.SimControl, delivery=EVERY, ros_type="std_msgs/msg/String", is_command=True
)
RECORDER_CONTROL = Channel(
    key="recorder/control", message=m.RecorderControl, delivery=EVERY, ros_type="std_msgs/msg/String", is_command=True
)
REPLAY_CONTROL = Channel(
    key="replay/control", message=m.ReplayControl, delivery=EVERY, ros_type="std_msgs/msg/String", is_command=True
)
JOINTS_STATE = Channel(
    key="joints/state",
    message=m.JointState,
    delivery=LATEST,
    ros_type="sensor_msgs/msg/JointState",
    rate_hz=100.0,
    is_kept=True,
)
ACTUATORS_STATE = Channel(
    key="actuators/state",
    message=m.ActuatorState,
    delivery=LATEST,
    ros_type="sensor_msgs/msg/JointState",
    rate_hz=100.0,
    is_kept=True,
)
LEG_STATE = Channel(
    key="leg/state",
    message=m.LegState,
    delivery=EVERY,
    ros_type="hyrecro_msgs/msg/LegState",
    rate_hz=10.0,
    is_kept=True,
)
FOOT_STATUS = Channel(
    key="foot/status", message=m.FootStatus, delivery=EVERY, ros_type="hyrecro_msgs/msg/FootStatus", is_kept=True
)
TF = Channel(
    key="tf", message=m.Transforms, delivery=LATEST, ros_type="tf2_msgs/msg/TFMessage", rate_hz=100.0, is_kept=True
)
TF_STATIC = Channel(
    key="tf_static", message=m.Transforms, delivery=EVERY, ros_type="tf2_msgs/msg/TFMessage", is_kept=True
)
CLOCK = Channel(
    key="clock",
    message=m.Clock,
    delivery=LATEST,
    ros_type="rosgraph_msgs/msg/Clock",
    rate_hz=100.0,
    is_kept=True,
)
ROBOT_DESCRIPTION = Channel(
    key="robot_description", message=m.RobotDescription, delivery=EVERY, ros_type="std_msgs/msg/String", is_kept=True
)
FIXED_FOOT_DESCRIPTION = Channel(
    key="fixed_foot_description",
    message=m.FixedFootDescription,
    delivery=EVERY,
    ros_type="std_msgs/msg/String",
    is_kept=True,
    topic="/fixed_foot/robot_description",  # Rerun takes a String for a URDF if its topic has this name in it
)
STRUCTURE_DESCRIPTION = Channel(
    key="structure_description",
    message=m.StructureDescription,
    delivery=EVERY,
    ros_type="std_msgs/msg/String",
    is_kept=True,
    topic="/world/robot_description",
)
LIDAR_POINTS = Channel(
    key="lidar/points",
    message=m.LidarScan,
    delivery=LATEST,
    ros_type="sensor_msgs/msg/PointCloud2",
    is_large=True,
    rate_hz=10.0,
)
LIDAR_IMU = Channel(key="lidar/imu", message=m.Imu, delivery=LATEST, ros_type="sensor_msgs/msg/Imu", rate_hz=100.0)
DEPTH_IMAGE = Channel(
    key="depth/image",
    message=m.DepthImage,
    delivery=LATEST,
    ros_type="sensor_msgs/msg/Image",
    is_large=True,
    rate_hz=15.0,
)
DEPTH_CAMERA_INFO = Channel(
    key="depth/camera_info",
    message=m.CameraInfo,
    delivery=LATEST,
    ros_type="sensor_msgs/msg/CameraInfo",
    rate_hz=15.0,
    is_kept=True,
)
DEPTH_POINTS = Channel(
    key="depth/points",
    message=m.PointCloud,
    delivery=LATEST,
    ros_type="sensor_msgs/msg/PointCloud2",
    is_large=True,
    rate_hz=15.0,
    is_recorded=False,  # made only while someone subscribes: the image says the same in a sixth of the bytes
)
DEPTH_IMU = Channel(key="depth/imu", message=m.Imu, delivery=LATEST, ros_type="sensor_msgs/msg/Imu", rate_hz=200.0)
SENSOR_CHANNELS = {
    "lidar": (LIDAR_POINTS, LIDAR_IMU),
    "depth": (DEPTH_IMAGE, DEPTH_CAMERA_INFO, DEPTH_POINTS, DEPTH_IMU),
}
"""By kind of sensor. A sensor is named after its kind, or begins with it: lidar, lidar_rear."""

MAP_ODOMETRY = Channel(
    key="map/odometry",
    message=m.Odometry,
    delivery=EVERY,
    ros_type="nav_msgs/msg/Odometry",
    rate_hz=10.0,
    is_kept=True,
)
MAP_CLOUD = Channel(
    key="map/cloud",
    message=m.PointCloud,
    delivery=LATEST,
    ros_type="sensor_msgs/msg/PointCloud2",
    is_large=True,
    rate_hz=1.0,
    is_kept=True,
)
MAP_PLANES = Channel(
    key="map/planes",
    message=m.PlaneMap,
    delivery=LATEST,
    ros_type="hyrecro_msgs/msg/PlaneMap",
    is_large=True,
    rate_hz=1.0,
    is_kept=True,
)
MAP_STATUS = Channel(
    key="map/status",
    message=m.MapStatus,
    delivery=EVERY,
    ros_type="hyrecro_msgs/msg/MapStatus",
    rate_hz=10.0,
    is_kept=True,
)
EVAL_METRICS = Channel(
    key="eval/metrics",
    message=m.TrackingMetrics,
    delivery=LATEST,
    ros_type="hyrecro_msgs/msg/TrackingMetrics",
    rate_hz=1.0,
    is_kept=True,
)
RECORDER_STATUS = Channel(
    key="recorder/status",
    message=m.RecorderStatus,
    delivery=EVERY,
    ros_type="hyrecro_msgs/msg/RecorderStatus",
    rate_hz=1.0,
    is_kept=True,
)
EVENTS = Channel(key="events", message=m.Event, delivery=EVERY, ros_type="rcl_interfaces/msg/Log")
HEALTH = Channel(
    key="health/*",
    message=m.Health,
    delivery=LATEST,
    ros_type="diagnostic_msgs/msg/DiagnosticArray",
    rate_hz=1.0,
    is_kept=True,
)

CHANNELS: tuple[Channel, ...] = (
    JOINTS_TARGET,
    LEG_TARGET,
    ACTUATORS_TARGET,
    FOOT_TARGET,
    ROBOT_STOP,
    SIM_CONTROL,
    RECORDER_CONTROL,
    REPLAY_CONTROL,
    JOINTS_STATE,
    ACTUATORS_STATE,
    LEG_STATE,
    FOOT_STATUS,
    TF,
    TF_STATIC,
    CLOCK,
    ROBOT_DESCRIPTION,
    FIXED_FOOT_DESCRIPTION,
    STRUCTURE_DESCRIPTION,
    *SENSOR_CHANNELS["lidar"],
    *SENSOR_CHANNELS["depth"],
    MAP_ODOMETRY,
    MAP_CLOUD,
    MAP_PLANES,
    MAP_STATUS,
    EVAL_METRICS,
    RECORDER_STATUS,
    EVENTS,
    HEALTH,
)


_OTHER_SENSOR = re.compile(rf"({'|'.join(SENSOR_CHANNELS)})_[a-z0-9_]+")


def channels_of(other_sensors: Iterable[str] = ()) -> tuple[Channel, ...]:
    """The whole table, with the channels of further sensors, which are named `<kind>_<name>`.

    Raises:
        ValueError: a name that does not begin with a kind of sensor.
    """
    return CHANNELS + tuple(channel for sensor in other_sensors for channel in sensor_channels(sensor))


def sensor_channels(sensor: str) -> tuple[Channel, ...]:
    """What one sensor may publish: `lidar`, `depth`, or a further one, `<kind>_<name>`.

    Raises:
        ValueError: the name does not begin with a kind of sensor.
    """
    if sensor in SENSOR_CHANNELS:
        return SENSOR_CHANNELS[sensor]
    match = _OTHER_SENSOR.fullmatch(sensor)
    if match is None:
        raise ValueError(
            f"no sensor can be called '{sensor}'; names are <kind>_<name>, kinds are {', '.join(SENSOR_CHANNELS)}"
        )
    return tuple(channel.of_sensor(sensor) for channel in SENSOR_CHANNELS[match[1]])


def channel_of_key(key: str) -> Channel | None:
    """The channel a concrete key belongs to, or None. A prefix set by Zenoh's `namespace` may stand before it."""
    start = key.find(PREFIX)
    name = key[start + len(PREFIX) :] if start >= 0 else ""
    sensor = name.partition("/")[0]
    for channel in channels_of([sensor] if _OTHER_SENSOR.fullmatch(sensor) else []):
        if channel.key == name:
            return channel
        stem = channel.key.removesuffix("*")
        if stem != channel.key and name.startswith(stem) and "/" not in name[len(stem) :] and name != stem:
            return channel.of(name[len(stem) :])
    return None


def channel_of_topic(topic: str) -> Channel | None:
    """The channel that is recorded as this topic, or None."""
    named = next((channel for channel in CHANNELS if channel.topic == topic), None)
    return named or channel_of_key(PREFIX + topic.removeprefix("/"))
