"""Draws what the sensors see: a scan, a thin bar's edge, a depth image with its holes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from services.sensors.depth.camera import DepthCamera
from services.sensors.lidar.scanner import LidarScanner
from services.sensors.loading import load_lidar, sensor_seed
from services.sim.node import load_sim
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import DepthImage, LidarScan, RobotDescription, StructureDescription, Transforms
from shared.runtime.config import Config
from shared.runtime.sensor_config import DepthConfig, LidarConfig

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PRESETS = ("ideal", "datasheet")
_BACKGROUND, _INK = "#12161a", "#d7dde3"
_REACH_M = 6.0
"""How far the pictured part of a scan reaches."""

_BAR_WIDTH_M, _BAR_DISTANCE_M, _WALL_BEHIND_M = 0.02, 5.0, 0.2
_EDGE_SCENE = f"""<robot name="s"><link name="world">
  <visual name="bar"><origin xyz="{_BAR_DISTANCE_M} 0 0" rpy="0.12 0 0"/><geometry>
    <box size="{_BAR_WIDTH_M} {_BAR_WIDTH_M} 2"/></geometry></visual>
  <visual name="wall"><origin xyz="{_BAR_DISTANCE_M + _WALL_BEHIND_M + 0.05} 0 0"/><geometry>
    <box size="0.1 1 2"/></geometry></visual>
</link></robot>"""


@dataclass(frozen=True, slots=True)
class View:
    """What there is to see, and from where."""

    robot: RobotDescription
    structure: StructureDescription
    transforms: Transforms


def first_view(config: Config) -> View:
    """The robot in its first posture on the structure.

    Raises:
        InputFileError: robot or structure are not usable.
    """
    sim = load_sim(config)
    try:
        said = {type(message): message for message in sim.start()}
    finally:
        sim.close()
    return View(said[RobotDescription], said[StructureDescription], said[Transforms])  # type: ignore[arg-type]


def draw_scan(path: Path, config: Config, view: View) -> None:
    """A scan without and with the errors of the datasheet: as range image, and as points around the robot."""
    figure, panels = _figure(2, 2, (15, 9), height_ratios=[1, 3.2])
    for column, preset in enumerate(_PRESETS):
        lidar = _lidar(config, preset)
        lidar.set_robot(view.robot)
        lidar.set_structure(view.structure)
        scan = lidar.scan([view.transforms])
        near = np.linalg.norm(scan.points_m, axis=1) < _REACH_M
        _draw_ranges(panels[0, column], scan, preset)
        T_world_sensor = FrameTree(view.transforms).T_root(scan.frame)
        _draw_points(panels[1, column], T_world_sensor.apply(scan.points_m[near]), scan.intensity[near])
    figure.savefig(path, dpi=100, facecolor=_BACKGROUND)


def draw_edge(path: Path) -> None:
    """A leaning bar of 20 mm before a wall, seen from above: met by beams of no width, and of the datasheet's."""
    figure, panels = _figure(1, 2, (13, 5.5))
    wide = {"exit_m": 0.01, "divergence_deg": 0.18}
    for panel, (title, changes) in zip(
        panels[0], (("beams are lines", {}), ("beams of true width", wide)), strict=True
    ):
        lidar = load_lidar(
            LidarConfig.model_validate({"preset": "ideal", "mode": "2048x10", "truth": True, **changes}), seed=1
        )
        lidar.set_robot(_description(RobotDescription, "lidar", '<robot name="r"><link name="lidar"/></robot>'))
        lidar.set_structure(_description(StructureDescription, "world", _EDGE_SCENE))
        scan = lidar.scan([_still("lidar")])
        mixed = _is_mixed(scan)
        x, y = scan.points_m[:, 0], 1000 * scan.points_m[:, 1]
        panel.scatter(y[~mixed], x[~mixed], s=7, color="#6eeb8c", linewidths=0, label="bar and wall")
        panel.scatter(y[mixed], x[mixed], s=7, color="#ff7043", linewidths=0, label="mixed")
        panel.set(title=title, xlabel="to the left [mm]", ylabel="forward [m]", xlim=(180, -180), ylim=(4.95, 5.25))
        panel.legend(facecolor=_BACKGROUND, labelcolor=_INK, edgecolor=_INK)
    figure.savefig(path, dpi=100, facecolor=_BACKGROUND)


def draw_depth(path: Path, config: Config, view: View) -> None:
    """A depth image without and with the errors of the datasheet; black is where there is no depth."""
    figure, panels = _figure(1, 2, (16, 5))
    for panel, preset in zip(panels[0], _PRESETS, strict=True):
        camera = _depth_camera(config, preset)
        camera.set_robot(view.robot)
        camera.set_structure(view.structure)
        image = camera.image(view.transforms)
        shown = panel.imshow(_depths_m(image), cmap="turbo_r", vmin=0.3, vmax=3.0, interpolation="nearest")
        panel.set(title=f"depth, {preset}", xticks=[], yticks=[])
    bar = figure.colorbar(shown, ax=list(panels[0]), shrink=0.8, label="depth [m]")
    bar.ax.yaxis.label.set_color(_INK)
    bar.ax.tick_params(colors=_INK)
    figure.savefig(path, dpi=100, facecolor=_BACKGROUND)


def _lidar(config: Config, preset: str) -> LidarScanner:
    sensor = config.sensors.lidar
    settings = {"preset": preset, "mode": "1024x10", "frame": sensor.frame, "backend": sensor.backend}
    return load_lidar(LidarConfig.model_validate(settings), sensor_seed(config.seed, "lidar"))


def _depth_camera(config: Config, preset: str) -> DepthCamera:
    sensor = config.sensors.depth
    settings: dict[str, object] = {"preset": preset, "mode": "1280x720", "frame": sensor.frame}
    settings |= {"backend": sensor.backend, "min_range_m": 0.3, "max_range_m": 3.0}
    return DepthCamera(DepthConfig.model_validate(settings), sensor_seed(config.seed, "depth"), lambda: False)


def _is_mixed(scan: LidarScan) -> Any:
    """Points that lie on neither of the surfaces: off the range their beam's axis, or nearest sub-ray, truly has."""
    assert scan.true_range_m is not None
    return np.abs(np.linalg.norm(scan.points_m, axis=1) - scan.true_range_m) > 0.002


def _depths_m(image: DepthImage) -> Any:
    depth_m = image.depth_mm.reshape(image.height, image.width) / 1000
    return np.ma.masked_equal(depth_m, 0.0)


def _draw_ranges(panel: Axes, scan: LidarScan, preset: str) -> None:
    azimuth_deg = np.rad2deg(np.arctan2(scan.points_m[:, 1], scan.points_m[:, 0]))
    ranges_m = np.linalg.norm(scan.points_m, axis=1)
    panel.scatter(
        -azimuth_deg, -scan.ring.astype(int), c=ranges_m, s=0.6, cmap="turbo_r", vmin=0, vmax=10, linewidths=0
    )
    panel.set(title=f"scan, {preset}: ring over azimuth, coloured by range", xticks=[], yticks=[], xlim=(-180, 180))


def _draw_points(panel: Axes, points_m: Any, intensity: Any) -> None:
    """The points in a look from obliquely above, without perspective, nearer ones over farther ones."""
    view = SE3.rot("x", np.deg2rad(-62)) @ SE3.rot("z", np.deg2rad(35))
    right, up, depth = view.apply(points_m.astype(np.float64) - points_m.mean(axis=0)).T
    order = np.argsort(depth)
    panel.scatter(right[order], up[order], c=intensity[order], s=1.2, cmap="viridis", linewidths=0)
    panel.set(title="the same within 6 m, coloured by intensity", xticks=[], yticks=[], aspect="equal")


def _figure(rows: int, columns: int, size: tuple[float, float], **grid: Any) -> tuple[Figure, Any]:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, gridspec_kw=grid)
    for panel in panels.flat:
        panel.set_facecolor("black")
        panel.title.set_color(_INK)
        panel.tick_params(colors=_INK)
        panel.xaxis.label.set_color(_INK)
        panel.yaxis.label.set_color(_INK)
    return figure, panels


def _description(kind: Any, frame: str, urdf: str) -> Any:
    return kind(stamp_ns=0, seq=0, frame=frame, urdf=urdf)


def _still(frame: str) -> Transforms:
    pose = SE3.identity().xyz_quat_xyzw[np.newaxis]
    return Transforms(stamp_ns=0, seq=0, frame="world", parents=("world",), children=(frame,), T_parent_child=pose)
