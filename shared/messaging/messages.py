"""Every message that travels between the processes: plain data, checked when built, read-only afterwards.

Measurements carry `stamp_ns` (simulated time at which they were measured), `seq` (counts up by one a message of
one publisher) and `frame` (what their coordinates refer to). Commands carry none of these: they count from receipt.
Poses travel as (7,) x y z in metres and the quaternion x y z w; use `SE3.from_xyz_quat_xyzw`.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from shared.errors import MessageError
from shared.messaging.fields import checked, specs_of
from shared.messaging.values import (
    ACTUATOR_NAMES as ACTUATOR_NAMES,
    JOINT_NAMES as JOINT_NAMES,
    MAX_PIXELS as MAX_PIXELS,
    MAX_PLACE_M as MAX_PLACE_M,
    MAX_SPEED as MAX_SPEED,
    MAX_STAMP_NS as MAX_STAMP_NS,
    Actuators as Actuators,
    Coefficients as Coefficients,
    Covariance as Covariance,
    Foot as Foot,
    FootPhase as FootPhase,
    Joints as Joints,
    Name as Name,
    NamedValues as NamedValues,
    PerPointFloat as PerPointFloat,
    PerPointNumber as PerPointNumber,
    PerPointRing as PerPointRing,
    PerPointTime as PerPointTime,
    Pixels as Pixels,
    Points as Points,
    Pose as Pose,
    Poses as Poses,
    RecorderAction as RecorderAction,
    ReplayAction as ReplayAction,
    Severity as Severity,
    SimAction as SimAction,
    Vector as Vector,
    Wrench as Wrench,
)

_MIN_LENGTH = 1e-6
"""Of a direction; its inverse is the largest."""


class Message:
    """Base: checks every field against its declaration, makes arrays read-only, compares by value.

    Raises:
        MessageError: naming the field, what it is and what is allowed.
    """

    VERSION: ClassVar[int] = 1
    SHORTHAND: ClassVar[str | None] = None
    """The field that a bare value typed by a person stands for: `B` for `{"foot": "B"}`."""
    IS_CERTAIN: ClassVar[bool] = False
    """Whether a command counts even where its bytes cannot be read: then all its fields have their defaults."""
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
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and np.array_equal(a, b)
    return bool(a == b)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measurement(Message):
    """Base of everything that was measured or computed at one simulated time.

    stamp_ns: from 0 to 2^31 seconds, what a ROS time can say. seq: from 0 up.
    """

    stamp_ns: int
    seq: int
    frame: Name

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
    valid_s: so long, in simulated time, the robot believes its commander to be there. The same target sent again renews
    it without disturbing the motion; when it runs out, the joints halt. None = until it is reached.
    """

    SHORTHAND: ClassVar[str | None] = "q"
    q: NamedValues
    names: tuple[Name, ...] | None = None
    duration_s: float | None = None
    valid_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stop(Message):
    """Every drive halts where it is, at once; steps and trajectories under way end. text: who stops, and why."""

    SHORTHAND: ClassVar[str | None] = "text"
    IS_CERTAIN: ClassVar[bool] = True
    text: str = ""

    @property
    def reason(self) -> str:
        """For people to read."""
        return f"stopped: {self.text}" if self.text else "stopped"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LegTarget(Message):
    """Which foot shall be the fixed one."""

    SHORTHAND: ClassVar[str | None] = "foot"
    foot: Foot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ActuatorTarget(Message):
    """Where the actuators shall go: all ten values, or those of `names`. Metres; radians for th_a and th_b."""

    SHORTHAND: ClassVar[str | None] = "positions"
    positions: NamedValues
    names: tuple[Name, ...] | None = None
    duration_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FootTarget(Message):
    """Where a foot shall be put: a pose of its plate's centre, or a point on the steel and the normal out of it there.

    foot: None = the free one. With a point the foot's turn about the normal is left to the planner.

    Raises:
        MessageError: neither or both of a pose and a point, a point without its normal, a normal too short or long,
            a place farther than `MAX_PLACE_M`.
    """

    foot: Foot | None = None
    T_world_foot: Pose | None = None
    point_m: Vector | None = None
    normal: Vector | None = None

    def __post_init__(self) -> None:
        Message.__post_init__(self)
        if (self.T_world_foot is None) == (self.point_m is None):
            raise MessageError("a foot target is either T_world_foot, or point_m and normal")
        if (self.point_m is None) != (self.normal is None):
            raise MessageError("point_m and normal belong together")
        if self.normal is not None and not _MIN_LENGTH <= math.hypot(*self.normal) <= 1 / _MIN_LENGTH:
            raise MessageError(f"normal must be of length {_MIN_LENGTH:g} to {1 / _MIN_LENGTH:g}")
        place = self.T_world_foot[:3] if self.T_world_foot is not None else self.point_m
        if place is not None and np.abs(place).max() > MAX_PLACE_M:
            raise MessageError(f"a place is farther than {MAX_PLACE_M:g} m from the origin")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimControl(Message):
    """What simulated time shall do. At least one field is given; all that are given are carried out.

    num_steps: for `step`, how many periods a paused simulation advances; None = one. seed: new seed of the simulation's
    random numbers. real_time_factor: seconds of simulated time a second.

    Raises:
        MessageError: nothing is asked for, or num_steps without `step`.
    """

    SHORTHAND: ClassVar[str | None] = "action"
    action: SimAction | None = None
    num_steps: int | None = None
    seed: int | None = None
    real_time_factor: float | None = None

    def __post_init__(self) -> None:
        Message.__post_init__(self)
        if self.action is None and self.seed is None and self.real_time_factor is None:
            raise MessageError("one of action, seed, real_time_factor must be given")
        if self.num_steps is not None and self.action is not SimAction.STEP:
            raise MessageError("num_steps belongs to the action step")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecorderControl(Message):
    """What the recorder shall do.

    run: name of the folder a start writes to, "" = the UTC time. channels: what a start records, patterns of keys below
    `hyrecro/` such as `lidar/*`; () = what the configuration says.

    Raises:
        MessageError: run or channels with another action than start.
    """

    SHORTHAND: ClassVar[str | None] = "action"
    action: RecorderAction
    run: str = ""
    channels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        Message.__post_init__(self)
        if (self.run or self.channels) and self.action is not RecorderAction.START:
            raise MessageError("run and channels belong to the action start")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplayControl(Message):
    """What a replay shall do. At least one field is given; all that are given are carried out, `seek_s` first.

    seek_s: goes on from so many seconds after the recording's first message. speed: recorded seconds a second.

    Raises:
        MessageError: nothing is asked for, a time before the recording, or a speed not within 0 and `MAX_SPEED`.
    """

    SHORTHAND: ClassVar[str | None] = "action"
    action: ReplayAction | None = None
    seek_s: float | None = None
    speed: float | None = None

    def __post_init__(self) -> None:
        Message.__post_init__(self)
        if self.action is None and self.seek_s is None and self.speed is None:
            raise MessageError("one of action, seek_s, speed must be given")
        if self.seek_s is not None and not 0 <= self.seek_s <= MAX_STAMP_NS / 1e9:
            raise MessageError(f"seek_s is {self.seek_s:g}, must be within 0..{MAX_STAMP_NS / 1e9:g}")
        if self.speed is not None and not 0 < self.speed <= MAX_SPEED:
            raise MessageError(f"speed is {self.speed:g}, must be above 0 and at most {MAX_SPEED:g}")


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

    T_world_foot: pose of the fixed foot's plate centre. has_contact: whether its sole is flush with steel. holding: the
    feet that hold on: both during a change, none in a fall. wrench: what the structure exerts on the fixed foot, about
    its sole's centre, along its plate's axes. load_n: pull on its magnet. margin: what is left of the magnet's limits
    (1 = unloaded, 0 = lets go); in mode kinematic those of statics. None = unknown, or the foot does not hold.
    """

    fixed_foot: Foot
    T_world_foot: Pose
    has_contact: bool | None = None
    holding: tuple[Foot, ...] | None = None
    wrench: Wrench | None = None
    load_n: float | None = None
    margin: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ActuatorState(Measurement):
    """Positions and velocities of the ten actuators, from the encoders of the joints; `frame` is the root link."""

    positions: Actuators
    velocities: Actuators


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FootStatus(Measurement):
    """How a step of a foot goes. Its coordinates are in `frame`.

    T_world_goal: pose of the foot's plate centre that the step ends in, None before it is known. progress: share of
    the motion, 0..1. duration_s: of the whole motion. margin: the least holding margin on the way. text: why it was
    refused, failed or stopped.
    """

    foot: Foot
    phase: FootPhase
    progress: float
    text: str = ""
    T_world_goal: Pose | None = None
    duration_s: float | None = None
    margin: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Transforms(Measurement):
    """Edges of the frame tree: T_parent_child of each, row by row. `frame` is the root of the tree."""

    parents: tuple[Name, ...]
    children: tuple[Name, ...]
    T_parent_child: Poses

    def __post_init__(self) -> None:
        Measurement.__post_init__(self)
        if not len(self.parents) == len(self.children) == len(self.T_parent_child):
            raise MessageError("parents, children and T_parent_child must have the same length")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clock(Measurement):
    """Simulated time: `stamp_ns` itself. real_time_factor: the wanted seconds of it a second, 0 while it is paused."""

    real_time_factor: float = 1.0


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

    points_m (N, 3): each in the sensor's frame as it stood when that point was measured. intensity (N,) 0..255.
    t_ns (N,): after `stamp_ns` when each point was measured. ring (N,): 0 = top.

    Ground truth, None unless asked for. member (N,): number of the shape met, counted through the visuals of
    structure_description, then of robot_description; of the k-th of sensors.other_robots k million and the number of
    the visual in its own. face (N,): of that shape, see `shared.meshes.faces_of`.
    true_range_m (N,): along the beam from its origin, without any error of the sensor.
    """

    points_m: Points
    intensity: PerPointFloat
    t_ns: PerPointTime
    ring: PerPointRing
    member: PerPointNumber | None = None
    face: PerPointNumber | None = None
    true_range_m: PerPointFloat | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Imu(Measurement):
    """What an IMU at the origin of `frame` measures, along that frame's axes.

    angular_velocity_radps (3,). linear_acceleration_mps2 (3,): of what it is held by, so at rest it reads 9.81 upwards.
    """

    angular_velocity_radps: Vector
    linear_acceleration_mps2: Vector


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthImage(Measurement):
    """Depth along the optical axis, in the optical frame of REP-103 (z forward, x right, y down).

    depth_mm (height * width,): row by row from the top left, 0 where there is none.

    Ground truth of each pixel, None unless asked for: `member`, `face` as in LidarScan (-1 where nothing is met), and
    true_depth_m (0 where nothing is met).

    Raises:
        MessageError: not height * width pixels.
    """

    height: int
    width: int
    depth_mm: Pixels
    member: PerPointNumber | None = None
    face: PerPointNumber | None = None
    true_depth_m: PerPointFloat | None = None

    def __post_init__(self) -> None:
        Measurement.__post_init__(self)
        if self.height <= 0 or self.width <= 0 or len(self.depth_mm) != self.height * self.width:
            raise MessageError(f"depth_mm has {len(self.depth_mm)} pixels, must be {self.height} x {self.width}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraInfo(Measurement):
    """Intrinsics of a camera without distortion, in pixels; the centre of the top left pixel is (0, 0).

    Raises:
        MessageError: an image without pixels, or numbers that are no camera's.
    """

    height: int
    width: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        Measurement.__post_init__(self)
        for name in ("height", "width", "fx", "fy"):
            if not 0 < (value := getattr(self, name)) <= MAX_PIXELS:
                raise MessageError(f"{name} is {value}, must be above 0 and at most {MAX_PIXELS}")
        for name in ("cx", "cy"):
            if abs(value := getattr(self, name)) > MAX_PIXELS:
                raise MessageError(f"{name} is {value}, must be within {MAX_PIXELS} of 0")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointCloud(Measurement):
    """Points (N, 3) in metres in `frame`."""

    points_m: Points


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Odometry(Measurement):
    """Estimated pose of `child_frame` in `frame`; covariance (6, 6) of translation then rotation, None if unknown."""

    child_frame: Name
    T_frame_child: Pose
    covariance: Covariance | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapStatus(Measurement):
    """How the registration of one scan went.

    scan_seq: the scan's `seq`. prior: what predicted the motion. is_tracking: the pose is believed; otherwise the
    sensor is lost, and its pose is the prediction. score: 0..1, how well the map explains the scan. fitness: mean
    squared distance of the inliers in m^2. is_suspect: another pose would fit as well.
    registration_ms: from the message to the pose, with what further scans are aligned to. lag_ms: from its receipt on.
    degenerate_axes: which of x y z roll pitch yaw (map frame) the scan does not determine; there the prior holds the
    pose. leg_slip_m: how far scans and legs disagree over the last second; None without legs. num_lost_scans: so far.
    """

    scan_seq: int
    method: str
    prior: str
    is_tracking: bool
    is_suspect: bool
    registration_ms: float
    lag_ms: float
    num_iterations: int
    num_points: int
    num_inliers: int
    score: float
    fitness: float | None
    degenerate_axes: tuple[str, ...]
    num_map_points: int
    num_scans_missed: int
    num_lost_scans: int
    leg_slip_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plane(Message):
    """One plane of the map: the points p of its surface have coefficients[:3] @ p + coefficients[3] = 0.

    id: stays the same while the plane is refined. coefficients (4,): the unit normal, towards the side it was seen
    from, then the offset in metres. num_inliers: points measured on it so far. outline_m (K, 3): corners of the part
    that was seen, counter-clockwise seen from there. colour (3,): red, green, blue, 0..1, a plane's own.
    """

    id: int
    coefficients: Coefficients
    num_inliers: int
    outline_m: Points
    colour: Vector


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaneMap(Measurement):
    """The planes of the map, in `frame`, by their ids."""

    planes: tuple[Plane, ...]


# ---- supervision


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingMetrics(Measurement):
    """Estimate against truth so far: RMSE of position (ATE), of the step between scans (RPE), and the last error.

    drift_m: of the last position, with the first poses laid together. map_accuracy_*: distance of the map's points to
    the true structure, of a part of its num_map_points. None = not known yet.
    """

    num_poses: int
    ate_rmse_m: float
    rpe_rmse_m: float
    last_error_m: float
    last_error_rad: float
    rpe_rmse_rad: float | None = None
    drift_m: float | None = None
    map_accuracy_mean_m: float | None = None
    map_accuracy_p95_m: float | None = None
    num_map_points: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Event(Measurement):
    """Something people should read: a refusal, a loss, a fall, a restart. `source` is the service that says it.

    refused_key: the key of the command that was refused; empty where the event is none.
    """

    source: Name
    severity: Severity
    text: str
    refused_key: Name = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChannelCount(Message):
    """What one service did with one key: messages sent, received, missed on the way, dropped by itself, refused.

    num_bytes_sent: of those sent. num_waiting: in its inbox now. wait_median_s, wait_max_s: how long those taken since
    the last heartbeat had waited there; None where none was taken.
    num_refused: bytes that are no message, and messages that could not be carried out; no other was received, too.
    """

    key: Name
    num_sent: int = 0
    num_received: int = 0
    num_missed: int = 0
    num_dropped: int = 0
    num_refused: int = 0
    last_seq: int | None = None
    num_bytes_sent: int = 0
    num_waiting: int = 0
    wait_median_s: float | None = None
    wait_max_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Health(Measurement):
    """A service's heartbeat, with shares of wall time since the last one.

    busy_ratio: its loop worked. cpu_ratio: of one core, by all its threads. shared_memory_bytes: what it has in use of
    memory it shares with others, such as the bus's; part of rss_bytes.
    """

    VERSION: ClassVar[int] = 2

    service: Name
    uptime_s: float
    rss_bytes: int
    busy_ratio: float
    channels: tuple[ChannelCount, ...]
    cpu_ratio: float = 0.0
    num_open_files: int = 0
    num_threads: int = 0
    shared_memory_bytes: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChannelRecord(Message):
    """What became of the messages of one key in a recording.

    num_published: by their publisher, as its numbers and its heartbeats tell; None for commands, which nobody numbers.
    num_received: by the recorder. num_written: handed to the operating system in a whole chunk. num_lost_on_bus:
    published and not received. num_lost_to_disk: received, and never to be written. Received and neither written nor
    lost is what still waits for its chunk.
    """

    key: Name
    num_received: int = 0
    num_written: int = 0
    num_lost_on_bus: int = 0
    num_lost_to_disk: int = 0
    num_published: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecorderStatus(Measurement):
    """How the recording goes, or how the last one ended.

    path: of the file being written, or of the last one; "" if there was none. num_files, num_bytes: of this recording.
    free_bytes: left on its disk. text: why it stopped by itself; "" if it did not. channels: by key.
    """

    is_recording: bool
    path: str
    num_files: int
    num_bytes: int
    free_bytes: int
    text: str = ""
    channels: tuple[ChannelRecord, ...] = ()
