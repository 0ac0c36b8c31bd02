"""Every message that travels between the processes: plain data, checked when built, read-only afterwards.

Measurements carry `stamp_ns` (simulated time at which they were measured), `seq` (counts up by one a message of
one publisher) and `frame` (what their coordinates refer to). Commands carry none of these: they count from receipt.
Poses travel as (7,) x y z in metres and the quaternion x y z w; use `SE3.from_xyz_quat_xyzw`.
"""

from __future__ import annotations

import dataclasses
import enum
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shared.errors import MessageError
from shared.messaging.fields import Array, checked, specs_of

Joints = Annotated[NDArray[np.float64], Array("float64", (8,), is_inline=True)]
"""Values of q1..q8 in order: radians, and metres for q2 and q7."""

Pose = Annotated[NDArray[np.float64], Array("float64", (7,), is_inline=True, is_pose=True)]
Poses = Annotated[NDArray[np.float64], Array("float64", ("N", 7), is_pose=True)]
NamedValues = Annotated[NDArray[np.float64], Array("float64", ("J",), is_inline=True)]
Points = Annotated[NDArray[np.float32], Array("float32", ("N", 3))]
PerPointFloat = Annotated[NDArray[np.float32], Array("float32", ("N",))]
PerPointTime = Annotated[NDArray[np.uint32], Array("uint32", ("N",))]
PerPointRing = Annotated[NDArray[np.uint16], Array("uint16", ("N",))]
Covariance = Annotated[NDArray[np.float64], Array("float64", (6, 6), is_inline=True)]

MAX_STAMP_NS = 2**31 * 10**9 - 1
"""ROS 2 counts the seconds of a time in an int32 (builtin_interfaces/Time)."""
JOINT_NAMES = ("q1", "q2", "q3", "q4", "q5", "q6", "q7", "q8")


class Foot(enum.Enum):
    """One of the robot's two magnetic feet."""

    A = "A"
    B = "B"

    @property
    def other(self) -> Foot:
        """The foot at the other end."""
        return Foot.B if self is Foot.A else Foot.A


class Severity(enum.Enum):
    """How much an event matters, as in ROS 2's rcl_interfaces/Log."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class Message:
    """Base: checks every field against its declaration, makes arrays read-only, compares by value.

    Raises:
        MessageError: naming the field, what it is and what is allowed.
    """

    VERSION: ClassVar[int] = 1
    SHORTHAND: ClassVar[str | None] = None
    """The field that a bare value typed by a person stands for: `B` for `{"foot": "B"}`."""
    __slots__ = ()

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for spec in specs_of(type(self)):
            object.__setattr__(self, spec.name, checked(spec, getattr(self, spec.name), sizes))

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        names = [field.name for field in dataclasses.fields(self)]  # type: ignore[arg-type]
        return all(_is_same(getattr(self, name), getattr(other, name)) for name in names)


def _is_same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and np.array_equal(a, b)
    return bool(a == b)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measurement(Message):
    """Base of everything that was measured or computed at one simulated time.

    stamp_ns: from 0 to 2^31 seconds, what a ROS time can say. seq: from 0 up.
    """

    stamp_ns: int
    seq: int
    frame: str

    def __post_init__(self) -> None:
        Message.__post_init__(self)
        if not 0 <= self.stamp_ns <= MAX_STAMP_NS:
            raise MessageError(f"stamp_ns is {self.stamp_ns}, must be within 0..{MAX_STAMP_NS}")
        if self.seq < 0:
            raise MessageError(f"seq is {self.seq}, must not be negative")


# ---- commands


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointTarget(Message):
    """Where the joints shall go: all eight values in `q`, or those of `names`. Radians; metres for q2 and q7.

    duration_s: the motion takes this long, or longer where velocity limits ask for it; without it, the limits decide.
    """

    SHORTHAND: ClassVar[str | None] = "q"
    q: NamedValues
    names: tuple[str, ...] | None = None
    duration_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LegTarget(Message):
    """Which foot shall be the fixed one."""

    SHORTHAND: ClassVar[str | None] = "foot"
    foot: Foot


# ---- the robot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointState(Measurement):
    """Joint positions and velocities as encoders report them; `frame` is the robot's root link.

    effort: Nm, N for q2 and q7; None where the simulation has no forces.
    """

    q: Joints
    dq: Joints
    effort: Joints | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LegState(Measurement):
    """Which foot is fixed and where it stands in `frame`.

    T_world_foot: pose of the fixed foot's plate centre. has_contact: whether its sole touches steel. load_n, margin:
    pull on the magnet in newtons and what is left of its limits (1 = unloaded, 0 = slips). None = not simulated.
    """

    fixed_foot: Foot
    T_world_foot: Pose
    has_contact: bool | None = None
    load_n: float | None = None
    margin: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Transforms(Measurement):
    """Edges of the frame tree: T_parent_child of each, row by row. `frame` is the root of the tree."""

    parents: tuple[str, ...]
    children: tuple[str, ...]
    T_parent_child: Poses

    def __post_init__(self) -> None:
        Measurement.__post_init__(self)
        if not len(self.parents) == len(self.children) == len(self.T_parent_child):
            raise MessageError("parents, children and T_parent_child must have the same length")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clock(Measurement):
    """Simulated time: `stamp_ns` itself."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotDescription(Measurement):
    """The robot as a URDF document; `frame` is its root link, whose pose in the world is in the transforms."""

    urdf: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixedFootDescription(Measurement):
    """A mark for viewers as a URDF document: its one link, `frame`, stands where the fixed foot is."""

    urdf: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StructureDescription(Measurement):
    """The structure and the ground as a URDF document; `frame` is the frame its root link coincides with."""

    urdf: str


# ---- sensors and map


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LidarScan(Measurement):
    """One revolution of a LiDAR: only the rays that returned, in raster order (ring by ring), in the sensor's frame.

    points_m (N, 3), intensity (N,) 0..255, t_ns (N,) after `stamp_ns` when each point was measured, ring (N,) 0 = top.
    """

    points_m: Points
    intensity: PerPointFloat
    t_ns: PerPointTime
    ring: PerPointRing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointCloud(Measurement):
    """Points (N, 3) in metres in `frame`."""

    points_m: Points


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Odometry(Measurement):
    """Estimated pose of `child_frame` in `frame`; covariance (6, 6) of translation then rotation, None if unknown."""

    child_frame: str
    T_frame_child: Pose
    covariance: Covariance | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapStatus(Measurement):
    """How the registration of one scan went.

    scan_seq: the scan's `seq`. fitness: mean squared distance of the inliers in m^2. lag_ms: from receipt to result.
    degenerate_axes: which of x y z roll pitch yaw (map frame) the scan does not determine.
    """

    scan_seq: int
    method: str
    is_tracking: bool
    registration_ms: float
    lag_ms: float
    num_iterations: int
    num_points: int
    num_inliers: int
    fitness: float | None
    degenerate_axes: tuple[str, ...]
    num_map_points: int
    num_scans_missed: int


# ---- supervision


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingMetrics(Measurement):
    """Estimate against truth so far: RMSE of position (ATE), of the step between scans (RPE), and the last error."""

    num_poses: int
    ate_rmse_m: float
    rpe_rmse_m: float
    last_error_m: float
    last_error_rad: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Event(Measurement):
    """Something people should read: a refusal, a loss, a restart. `source` is the service that says it."""

    source: str
    severity: Severity
    text: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChannelCount(Message):
    """What one service did with one key: messages sent, received, missed on the way, dropped by itself, refused."""

    key: str
    num_sent: int = 0
    num_received: int = 0
    num_missed: int = 0
    num_dropped: int = 0
    num_refused: int = 0
    last_seq: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Health(Measurement):
    """A service's heartbeat. busy_ratio: share of wall time spent working since the last one."""

    service: str
    uptime_s: float
    rss_bytes: int
    busy_ratio: float
    channels: tuple[ChannelCount, ...]
