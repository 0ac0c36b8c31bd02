"""The sensors' part of the configuration. What a sensor is like comes from a preset: a file in configs/sensors/."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationInfo, model_validator

from shared.errors import InputFileError
from shared.files import read_text
from shared.runtime.section import CONFIGS_DIR, InputFile, Section, Vector3
from shared.yaml_reading import load_yaml

PRESETS_DIR = CONFIGS_DIR / "sensors"

LidarMode = Literal["512x10", "1024x10", "2048x10", "512x20", "1024x20"]
DepthMode = Literal["848x480", "1280x720"]
Backend = Literal["scan_conversion", "embree"]


class MountConfig(Section):
    """Where a sensor sits: its frame becomes a link fixed to `parent`."""

    parent: str = "hip"
    xyz_m: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)


class ImuConfig(Section):
    """An inertial measurement unit at the sensor's frame. Noise and walk are spectral densities."""

    rate_hz: float = Field(ge=0, le=1000)
    """0 = none."""
    gyro_noise_radps_per_sqrt_hz: float = Field(ge=0, le=1)
    """White noise of the angular rate."""
    gyro_walk_radps2_per_sqrt_hz: float = Field(ge=0, le=1)
    """Of the bias, a random walk."""
    gyro_bias_radps: float = Field(ge=0, le=1)
    """Standard deviation of the bias at the start."""
    accel_noise_mps2_per_sqrt_hz: float = Field(ge=0, le=10)
    """White noise of the acceleration."""
    accel_walk_mps3_per_sqrt_hz: float = Field(ge=0, le=10)
    """Of its bias."""
    accel_bias_mps2: float = Field(ge=0, le=10)
    """Standard deviation of its bias at the start."""


class SurfaceConfig(Section):
    """How a material answers a LiDAR's light."""

    reflectivity: float = Field(ge=0, le=1)
    max_incidence_deg: float = Field(ge=0, le=90)
    """Bare steel mirrors: beyond this angle to its normal nothing comes back. 90 = no limit."""


class SensorConfig(Section):
    """What all sensors have. Settings that are not given are those of the preset."""

    KIND: ClassVar[str]
    enabled: bool = True
    """Whether `hyrecro up` starts it."""
    frame: str
    mount: MountConfig | None = None
    """None: the robot's URDF has the frame."""
    backend: Backend = "scan_conversion"
    """How rays find what they meet: faces drawn into the sensor's grid, or rays cast by Embree."""
    preset: InputFile
    """ideal, original, datasheet, or a file like those in configs/sensors/."""
    truth: bool = False
    """Whether each point or pixel tells the member, face and range it truly met."""

    @model_validator(mode="before")
    @classmethod
    def _on_preset(cls, given: Any, info: ValidationInfo) -> Any:
        if not isinstance(given, Mapping):
            return given
        base_dir = Path((info.context or {}).get("base_dir", CONFIGS_DIR))
        preset = given.get("preset", cls.model_fields["preset"].default)
        path = _preset_path(cls.KIND, Path(str(preset)), base_dir)
        return _merged(_read_preset(path, set(cls.model_fields)), {**given, "preset": path})


def _preset_path(kind: str, preset: Path, base_dir: Path) -> Path:
    for path in (base_dir / preset, CONFIGS_DIR / preset, PRESETS_DIR / f"{kind}_{preset}.yaml"):
        if path.is_file():
            return path.resolve()
    names = ", ".join(sorted(path.stem.removeprefix(f"{kind}_") for path in PRESETS_DIR.glob(f"{kind}_*.yaml")))
    raise ValueError(f"no such preset: {preset}; presets are {names}, or give a file")


def _read_preset(path: Path, known: set[str]) -> dict[str, Any]:
    try:
        settings = load_yaml(read_text(path), str(path))
    except InputFileError as error:
        raise ValueError(str(error)) from error
    if not isinstance(settings, dict):
        raise ValueError(f"{path}: must be a map of settings, is {type(settings).__name__}")
    if strange := [str(name) for name in settings if name not in known]:
        raise ValueError(f"{path}: unknown setting {strange[0]}; known are {', '.join(sorted(known))}")
    beams = settings.get("beams")
    if beams is not None and (path.parent / str(beams)).is_file():
        settings["beams"] = path.parent / str(beams)
    return settings


def _merged(base: dict[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for name, value in over.items():
        below = merged.get(name)
        merged[name] = _merged(below, value) if isinstance(below, dict) and isinstance(value, Mapping) else value
    return merged


def _check_ranges(config: LidarConfig | DepthConfig) -> None:
    if config.min_range_m >= config.max_range_m:
        raise ValueError(f"min_range_m {config.min_range_m} must be below max_range_m {config.max_range_m}")


class LidarConfig(SensorConfig):
    """A spinning LiDAR: an Ouster OS1-128 with the presets' tables of beams."""

    KIND = "lidar"
    kind: Literal["lidar"] = "lidar"
    """What a further sensor is."""
    frame: str = "lidar"
    """The link that carries the sensor's frame: z up along its axis; its clouds and IMU refer to it."""
    preset: InputFile = Path("original")
    mode: LidarMode = "512x10"
    """Columns a revolution x revolutions a second."""
    beams: InputFile
    """Table of the beams' angles: YAML like those in configs/sensors/beams/, or the metadata JSON of a real Ouster."""
    rolling_shutter: bool
    """Whether columns fire one after the other while the robot moves, or all at once."""
    near_clip_m: float = Field(ge=0, le=10)
    """Beams begin here: what is nearer is passed through."""
    min_range_m: float = Field(ge=0, le=100)
    """Blind zone: what is nearer blocks the beam but returns nothing."""
    max_range_m: float = Field(gt=0, le=1000)
    """What is farther returns nothing."""
    self_hits: bool
    """Whether the robot is in the way of the beams."""
    body_filter: bool
    """Whether the returns of beams that met the robot are taken out, as a driver does that knows the posture."""
    range_noise_m: float = Field(ge=0, le=1)
    """Standard deviation of the range on a strong signal."""
    weak_range_noise_m: float = Field(ge=0, le=1)
    """What is added to it, in squares, where half the beams return; it goes with the root of the signal's inverse."""
    range_quantum_m: float = Field(ge=0, le=0.1)
    """Ranges are whole multiples of this. 0 = any."""
    detection_range_m: float = Field(ge=0, le=1000)
    """Where half the beams return that meet a diffuse surface of 10 % head-on. 0 = no dropouts."""
    detection_steepness: float = Field(gt=0, le=100)
    """The chance of a return is s^k / (1 + s^k), s the signal over that with even chances, k this number."""
    incidence_fade_deg: float = Field(ge=0, le=90)
    """A surface's returns fade over this angle up to its max_incidence_deg."""
    exit_m: float = Field(ge=0, le=0.1)
    """Diameter of a beam where it leaves the sensor. 0, and no divergence = a line."""
    divergence_deg: float = Field(ge=0, le=5)
    """Full angle by which it widens."""
    pulse_m: float = Field(ge=0, le=10)
    """Surfaces within one beam mix into one range when they are nearer than this along it."""
    surfaces: dict[str, SurfaceConfig]
    """By material in the descriptions; `default` is for all others."""
    imu: ImuConfig

    @property
    def num_columns(self) -> int:
        """Columns a revolution."""
        return int(self.mode.partition("x")[0])

    @property
    def rate_hz(self) -> float:
        """Revolutions a second."""
        return float(self.mode.partition("x")[2])

    @model_validator(mode="after")
    def _checked(self) -> LidarConfig:
        _check_ranges(self)
        if "default" not in self.surfaces:
            raise ValueError("surfaces must have an entry `default`")
        return self


class DepthConfig(SensorConfig):
    """A stereo depth camera: an Intel RealSense D435i, without its colour camera."""

    KIND = "depth"
    kind: Literal["depth"] = "depth"
    """What a further sensor is."""
    frame: str = "depth_optical"
    """The link that carries the optical frame of REP-103: z forward, x right, y down."""
    preset: InputFile = Path("original")
    mode: DepthMode = "848x480"
    """Columns x rows of an image."""
    rate_hz: Literal[6, 15, 30] = 15
    """Images a second."""
    horizontal_fov_deg: float = Field(gt=1, lt=170)
    """Of the whole image."""
    baseline_m: float = Field(gt=0, le=1)
    """From one of the two cameras to the other."""
    near_clip_m: float = Field(gt=0, le=10)
    """What is nearer than this depth is passed through."""
    min_range_m: float = Field(ge=0, le=65)
    """Depths below are not given."""
    max_range_m: float = Field(gt=0, le=65.535)
    """Depths beyond are not given; a pixel holds at most 65.535 m."""
    self_hits: bool
    """Whether the robot is in view."""
    correlated_noise_px: float = Field(ge=0, le=10)
    """Standard deviation of the disparity's noise that neighbours share."""
    correlation_px: float = Field(gt=0, le=100)
    """The lag at which they share half of it."""
    white_noise_px: float = Field(ge=0, le=10)
    """Standard deviation of the noise of each pixel alone."""
    static_noise_px: float = Field(ge=0, le=10)
    """The same of noise that neighbours share and that stays from image to image."""
    disparity_quantum_px: float = Field(ge=0, le=1)
    """Disparities are whole multiples of this. 0 = any."""
    max_disparity_px: float = Field(ge=0, le=10_000)
    """What is nearer than fx * baseline / this is not matched. 0 = no limit."""
    edge_jitter_px: float = Field(ge=0, le=10)
    """By how much outlines are displaced."""
    shadow: bool
    """Whether pixels have no depth that only one of the two cameras sees, left of what is near."""
    max_incidence_deg: float = Field(ge=0, le=90)
    """Beyond this angle between ray and normal there is no depth. 90 = no limit."""
    incidence_fade_deg: float = Field(ge=0, le=90)
    """Holes become more frequent over this angle up to max_incidence_deg."""
    imu: ImuConfig

    @property
    def width(self) -> int:
        """Pixels a row."""
        return int(self.mode.partition("x")[0])

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.mode.partition("x")[2])

    @model_validator(mode="after")
    def _checked(self) -> DepthConfig:
        _check_ranges(self)
        return self


OtherName = Annotated[str, Field(pattern=r"^(lidar|depth)_[a-z0-9_]+$")]
RobotName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*$")]
OtherSensor = Annotated[LidarConfig | DepthConfig, Field(discriminator="kind")]


class SensorsConfig(Section):
    """Each sensor runs in its own process: `python -m services.sensors --sensor NAME`."""

    lidar: LidarConfig = Field(default_factory=lambda: LidarConfig.model_validate({}))
    depth: DepthConfig = Field(default_factory=lambda: DepthConfig.model_validate({}))
    others: dict[OtherName, OtherSensor] = Field(default_factory=dict)
    """Further sensors by name; the name begins with the kind, and is the first part of the sensor's keys."""
    other_robots: tuple[RobotName, ...] = ()
    """Namespaces (bus.namespace) of the robots in the same world: the sensors see them."""

    def named(self) -> dict[str, LidarConfig | DepthConfig]:
        """Every sensor that is configured, enabled or not, by its name."""
        return {"lidar": self.lidar, "depth": self.depth, **self.others}

    @model_validator(mode="after")
    def _names_fit(self) -> SensorsConfig:
        for name, sensor in self.others.items():
            if not name.startswith(sensor.kind):
                raise ValueError(f"others.{name}: the name of a {sensor.kind} begins with {sensor.kind}_")
        if len(set(self.other_robots)) < len(self.other_robots):
            raise ValueError(f"other_robots names one twice: {', '.join(self.other_robots)}")
        return self
