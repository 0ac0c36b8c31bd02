"""The typed configuration: what can be set, in which unit, in which range. Loading is in `config_loading`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from shared.messaging.messages import Foot
from shared.runtime.section import CONFIGS_DIR as CONFIGS_DIR, InputFile, Section, Vector3
from shared.runtime.sensor_config import SensorsConfig


class BusConfig(Section):
    """The Zenoh router and how to reach it."""

    endpoint: str = Field("tcp/127.0.0.1:7447", pattern=r"^(tcp|tls|quic|unixsock-stream)/.+$")
    """Where the router listens and everyone connects."""
    namespace: str = Field("", pattern=r"^([A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*)?$")
    """Put before every key, for several robots on one router."""
    credentials: Path | None = None
    """Of a secure bus: a file that `hyrecro certs new` makes, or their folder, where everyone takes theirs."""
    connect_timeout_s: float = Field(10.0, gt=0, le=3600)
    """How long a service waits for the router before it gives up."""
    shared_memory_mib: int = Field(64, ge=0, le=4096)
    """Size of each process's pool for large messages; 0 switches shared memory off."""

    @model_validator(mode="after")
    def _secure_with_credentials(self) -> BusConfig:
        is_secure = self.endpoint.startswith(("tls/", "quic/"))
        if is_secure and self.credentials is None:
            raise ValueError(f"endpoint {self.endpoint} needs credentials: `hyrecro certs new` makes them")
        if self.credentials is not None and not is_secure:
            raise ValueError(f"credentials need an endpoint that begins with tls/ or quic/, got {self.endpoint}")
        return self


class EncoderConfig(Section):
    """How the joints' encoders err; standard deviations. A bias is drawn once a run, noise at every reading."""

    bias_rad: float = Field(0.0, ge=0, le=1)
    noise_rad: float = Field(0.0, ge=0, le=1)
    piston_bias_m: float = Field(0.0, ge=0, le=0.1)
    piston_noise_m: float = Field(0.0, ge=0, le=0.1)


class SlipConfig(Section):
    """How far a foot slides when it takes hold; standard deviations."""

    slide_m: float = Field(0.0, ge=0, le=0.1)
    """Along each of the sole's axes."""
    turn_deg: float = Field(0.0, ge=0, le=45)


class MagnetConfig(Section):
    """When a foot takes hold of steel, and what it bears."""

    pull_n: float = Field(323.7, gt=0, le=100_000)
    """33 kg a leg, as published for the robot's switchable magnets."""
    half_width_m: float = Field(0.05, gt=0, le=1)
    """From the sole's centre to the edge about which it tilts."""
    friction: float = Field(0.5, gt=0, le=5)
    """Of the sole on steel: assumed."""
    max_gap_m: float = Field(0.002, gt=0, le=0.02)
    max_angle_deg: float = Field(2.0, gt=0, le=45)
    """A foot takes hold within this gap and angle of steel, below its whole sole: assumed."""
    overlap_s: float = Field(0.2, ge=0, le=10)
    """How long both feet hold at a change."""


class DynamicsConfig(Section):
    """The physics of mode `dynamic`. Masses, inertias, velocity and effort limits are those of the URDF."""

    gravity_mps2: float = Field(9.81, ge=0, le=100)
    step_hz: float = Field(1000.0, ge=100, le=10_000)
    """About how often the engine steps: as often as makes whole steps of a period of sim.rate_hz."""
    num_solver_iterations: int = Field(100, ge=1, le=10_000)
    ramp_s: float = Field(0.2, gt=0, le=10)
    """The drives take this long from rest to their velocity limit."""
    bandwidth_hz: float = Field(10.0, gt=0, le=100)
    """How quickly the drives take away what is left of an error."""
    sole_stiffness_n_per_m: float = Field(5e4, gt=0, le=1e9)
    sole_damping_ns_per_m: float = Field(500.0, ge=0, le=1e6)
    """Of each point at which a sole that does not hold touches steel: assumed, a layer of hard rubber."""


class ActuatorConfig(Section):
    """The parallel modules of the legs; lengths remembered from the robot's papers, to be measured on the prototype."""

    base_half_m: float = Field(0.04, gt=0, le=1)
    platform_half_m: float = Field(0.04, gt=0, le=1)
    min_piston_m: float = Field(0.19, gt=0, le=10)
    max_piston_m: float = Field(0.25, gt=0, le=10)
    core_link_m: float = Field(0.245, ge=0, le=10)
    """Pistons at mid-stroke then mean q2 = q7 = 0."""

    @model_validator(mode="after")
    def _ordered(self) -> ActuatorConfig:
        if self.min_piston_m >= self.max_piston_m:
            raise ValueError(f"min_piston_m {self.min_piston_m} must be below max_piston_m {self.max_piston_m}")
        return self


class SimConfig(Section):
    """The simulated robot and world."""

    mode: Literal["kinematic", "dynamic"] = "kinematic"
    """Kinematic: the fixed foot holds, the joints are where they are told. Dynamic: masses, drives, magnets, falls."""
    rate_hz: float = Field(100.0, ge=10, le=1000)
    real_time_factor: float = Field(1.0, ge=0.01, le=100)
    """Seconds of simulated time a second, where the machine can."""
    leg_state_rate_hz: float = Field(10.0, gt=0, le=100)
    initial_foot: Foot = Foot.A
    initial_foot_xyz_m: Vector3 = (0.0, -0.775, 10.105)
    """Plate centre of the fixed foot in the world; 10.105 puts its sole on the bar's top at 10.1."""
    initial_foot_rpy_deg: Vector3 = (0.0, 0.0, 90.0)
    encoders: EncoderConfig = EncoderConfig()
    slip: SlipConfig = SlipConfig()
    actuators: ActuatorConfig = ActuatorConfig()
    magnets: MagnetConfig = MagnetConfig()
    dynamics: DynamicsConfig = DynamicsConfig()


class MapperConfig(Section):
    """Online registration and the map."""

    input: Literal["lidar", "depth"] = "lidar"
    """What is mapped: the scans of sensors.lidar, or the images of sensors.depth."""
    method: str = Field("plane", pattern=r"^([a-z_]+|[^:]+:[A-Za-z_][A-Za-z0-9_]*)$")
    """A name in services/mapper/methods, or FILE.py:CLASS for one of your own."""
    scan_to: Literal["map", "scan"] = "map"
    """What a scan is aligned to: the map of all scans, or the scan before it."""
    prior: Literal["constant_velocity", "imu", "legs"] = "legs"
    """What predicts the motion between two scans: their trend, the sensor's IMU, or joints and feet."""
    deskew: bool = True
    """Takes the sensor's own motion out of each scan, as the prior knows it."""
    min_range_m: float = Field(0.5, ge=0, le=100)
    """Beyond the robot's own reach: its feet come to 0.44 m of the sensor, and moving parts do not belong in a map."""
    max_range_m: float = Field(10.0, gt=0, le=1000)
    crop_m: tuple[float, float, float, float, float, float] | None = None
    """x0 x1 y0 y1 z0 z1 of a box in the sensor's frame, outside of which points are dropped. None: no box."""
    body: bool = True
    """Drops points on the robot itself, where joints and feet are known."""
    num_outlier_neighbours: int = Field(0, ge=0, le=100)
    """Points are dropped that lie far from so many nearest neighbours; 0 = no such filter."""
    outlier_deviations: float = Field(2.0, gt=0, le=100)
    """How many standard deviations beyond the mean distance to the neighbours is far."""
    range_noise_m: float | None = Field(None, gt=0, le=1)
    """Standard deviation of a range, for the method `plane`. None: found from the first scans."""
    voxel_size_m: float = Field(0.05, gt=0, le=10)
    """Edge of the voxels that thin scans and map; finer maps cost time with its square."""
    max_map_points: int = Field(500_000, ge=1000, le=100_000_000)
    """The map stops growing here."""
    max_planes: int = Field(4000, ge=10, le=100_000)
    """The method `plane` takes up no further patches beyond so many."""
    keyframe_novelty: float = Field(0.05, ge=0, le=1)
    """A scan enters the target of the point methods when what it did not explain, as shares of the scans since, adds
    up to this."""
    max_correspondence_m: float = Field(0.1, gt=0, le=10)
    """Pairs of scan and map may be so far apart: below the bars' width, or a bar's two faces are mixed up."""
    search_correspondence_m: float = Field(1.0, gt=0, le=100)
    """The same for the first guess of a wider search, when the prediction does not lead to a good registration."""
    min_score: float = Field(0.5, gt=0, le=1)
    """A registration is not believed below this share of explained points (less where they lie off their surfaces)."""
    max_jump_m: float = Field(1.0, gt=0, le=100)
    max_jump_deg: float = Field(90.0, gt=0, le=180)
    """A registration farther than this from both the prediction and the last tracked pose is not believed."""
    max_iterations: int = Field(20, ge=1, le=1000)
    max_leg_error_m: float = Field(0.01, gt=0, le=10)
    max_leg_error_deg: float = Field(1.5, gt=0, le=180)
    """Where legs and scans disagree by more over a second, a foot is said to have slipped: encoders explain less."""
    depth_stride: int = Field(4, ge=1, le=64)
    """Of depth images, only every so many rows and columns are taken."""
    map_file: InputFile | None = None
    """A cloud to begin with: the first scan is looked for in it, and its frame is the map's."""
    map_rate_hz: float = Field(1.0, gt=0, le=10)
    num_threads: int = Field(1, ge=1, le=64)

    @field_validator("crop_m")
    @classmethod
    def _box_is_not_empty(cls, crop_m: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if crop_m is not None and any(low >= high for low, high in zip(crop_m[::2], crop_m[1::2], strict=True)):
            raise ValueError("must be x0,x1,y0,y1,z0,z1 with each first number below its second")
        return crop_m


class RecorderConfig(Section):
    """The MCAP recording."""

    directory: Path = Path("out")
    """Runs are written to DIRECTORY/<UTC time>/, with a link `latest`."""
    run: str = Field("", pattern=r"^[A-Za-z0-9_.:-]*$")
    """Name of the run's folder; empty = the UTC time at the start."""
    compression: Literal["lz4", "zstd", "none"] = "lz4"
    """Of chunks: lz4 is quicker, zstd smaller."""
    chunk_size_kib: int = Field(1024, ge=64, le=65536)
    chunk_period_s: float = Field(0.5, gt=0, le=60)
    """A chunk is closed at least this often: a killed recorder loses no more than this."""
    max_queue_mib: int = Field(256, ge=16, le=65536)
    """What may wait for the recorder, and as much again for its disk."""
    max_file_mib: int = Field(0, ge=0, le=1024 * 1024)
    """A file that has grown to this is followed by another: run.mcap, run_001.mcap ... 0: never."""
    max_file_s: float = Field(0.0, ge=0, le=1e6)
    """The same by the time it spans. 0: never."""
    min_free_mib: int = Field(64, ge=0, le=1024 * 1024)
    """The recording stops before less than this is left on the disk."""
    channels: tuple[str, ...] = ("*",)
    """What is recorded at most: patterns of keys below `hyrecro/`, such as lidar/*. The rest is not subscribed to."""
    starts: bool = True
    """Records from the start; otherwise when told to."""


class PlayerConfig(Section):
    """How `hyrecro robot play` moves through a trajectory file."""

    trajectory: InputFile = Path("trajectories/climb.csv")
    rate_hz: float = Field(9.0, gt=0, le=1000)
    """Commands a second of simulated time."""
    speed_radps: float | None = Field(None, gt=0, le=10)
    """Of the joint with the longest way; a piston's metre counts as 10 rad. None: each row takes num_steps commands,
    as in the original simulation."""
    ramp_s: float = Field(0.5, ge=0, le=60)
    """With a speed, each row takes this long to reach it and to stop."""
    num_steps: int = Field(100, ge=1, le=100_000)
    position_tolerance: float = Field(1e-3, gt=0, le=1)
    """A target is reached when every joint is this near: radians, metres for q2 and q7."""
    timeout_s: float = Field(30.0, gt=0, le=3600)


class PlannerConfig(Section):
    """How a foot is lifted, carried over and landed."""

    rate_hz: float = Field(20.0, gt=0, le=1000)
    """Intermediate targets a second of simulated time."""
    speed_share: float = Field(0.5, gt=0, le=1)
    """Of the joints' velocity limits."""
    ramp_s: float = Field(0.2, ge=0, le=60)
    """Lift, transfer and landing each take this long to get up to speed, and to stop."""
    lift_m: float = Field(0.03, ge=0.01, le=0.2)
    """A foot leaves and lands along its normal by this, or less where there is no room."""
    min_margin: float = Field(0.0, ge=-10, le=1)
    """A step on which the holding margin falls below this is refused."""
    max_iterations: int = Field(1000, ge=1, le=1_000_000)
    """Of the search for a way round what is between, at some 3 ms each; that for a better way may add half as many."""
    joint_tolerance: float = Field(0.02, gt=0, le=1)
    """A step has ended when every joint is this near, as its encoder reads it: radians, metres for q2 and q7."""
    timeout_s: float = Field(10.0, gt=0, le=3600)
    """Of simulated time, for the joints to arrive or the feet to change."""


class TeleopConfig(Section):
    """The page in a browser."""

    enabled: bool = False
    """Whether `hyrecro up` starts it too."""
    host: str = "127.0.0.1"
    """Where it listens: whoever reaches it can move the robot. Inside a container 0.0.0.0, published on loopback."""
    port: int = Field(8080, ge=1, le=65535)
    origins: tuple[Annotated[str, Field(pattern=r"^https?://[^/]+$")], ...] = ()
    """Further addresses of the page, such as http://robot.lan:8080; pages of other sites are refused."""
    rate_hz: float = Field(10.0, ge=1, le=50)
    """Joint targets a second, renewals too."""
    valid_s: float = Field(0.5, gt=0, le=10)
    """A joint target that is not renewed for so long halts the robot."""
    silence_s: float = Field(2.0, gt=0, le=60)
    """A page that commands and does not answer for so long halts the robot."""
    speed_share: float = Field(0.3, gt=0, le=1)
    """Of the joints' velocity limits, to begin with."""
    postures: InputFile = Path("postures.csv")
    max_points: int = Field(20_000, ge=100, le=1_000_000)
    """Scan and map are thinned to so many points each."""

    @property
    def url(self) -> str:
        """Where a browser on this machine finds the page."""
        host = "127.0.0.1" if self.host in ("0.0.0.0", "::") else self.host  # noqa: S104 - it is compared
        return f"http://{host}:{self.port}"

    @model_validator(mode="after")
    def _renewed_in_time(self) -> TeleopConfig:
        if self.valid_s < 2 / self.rate_hz:
            raise ValueError(f"valid_s {self.valid_s} must be at least two periods of rate_hz, {2 / self.rate_hz:g}")
        return self


class EvaluatorConfig(Section):
    """Comparison with the truth."""

    rate_hz: float = Field(1.0, gt=0, le=10)
    plane_distance_m: float = Field(0.04, gt=0, le=1)
    num_planes: int = Field(11, ge=1, le=1000)


class Config(Section):
    """Everything. Input files are relative to the configuration file; recordings go below the working directory."""

    seed: int = Field(1, ge=0, le=2**32 - 1)
    robot: InputFile = Path("robot/hyrecro.urdf")
    fixed_foot_mark: InputFile = Path("robot/fixed_foot.urdf")
    """What viewers draw at the fixed foot."""
    structure: InputFile = Path("structures/original.yaml")
    state_directory: Path | None = None
    """Where services keep what they know, for when they are started again; None: nowhere. `hyrecro up` makes one."""
    bus: BusConfig = BusConfig()
    sim: SimConfig = SimConfig()
    sensors: SensorsConfig = SensorsConfig()
    mapper: MapperConfig = MapperConfig()
    recorder: RecorderConfig = RecorderConfig()
    player: PlayerConfig = PlayerConfig.model_construct()
    planner: PlannerConfig = PlannerConfig()
    evaluator: EvaluatorConfig = EvaluatorConfig()
    teleop: TeleopConfig = TeleopConfig.model_construct()

    @model_validator(mode="after")
    def _sees_others(self) -> Config:
        if self.bus.namespace in self.sensors.other_robots:
            raise ValueError(f"sensors.other_robots has the robot's own namespace {self.bus.namespace}")
        return self

    @field_validator("player", "teleop", mode="before")
    @classmethod
    def _default_is_checked(cls, value: object) -> object:
        return {} if isinstance(value, Section) else value
