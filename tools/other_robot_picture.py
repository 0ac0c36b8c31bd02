"""Draws one scan of robot_a with robot_b in view: `python -m tools.other_robot_picture other_robot.png`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt

from cli.sensor_pictures import first_view
from services.sensors.loading import load_lidar, sensor_seed
from services.sensors.surroundings import MEMBERS_A_ROBOT
from shared.messaging.frames import FrameTree
from shared.runtime.config_loading import load_config

BACKGROUND, INK, STEEL, OTHER = "#12161a", "#d7dde3", "#7f8c99", "#ff5c4d"
VIEW_FROM_DEG = {"elev": 18, "azim": -50}


def main() -> None:
    """Takes the scan and writes the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, metavar="PICTURE.png")
    path = parser.parse_args().path
    ours, other = (first_view(load_config(Path(name), ["sensors.lidar.truth=true"])) for name in ("robot_a", "robot_b"))
    config = load_config(Path("robot_a"), ["sensors.lidar.truth=true", "sensors.lidar.mode=2048x10"])
    lidar = load_lidar(config.sensors.lidar, sensor_seed(config.seed, "lidar"), other_robots=("robot_b",))
    lidar.set_robot(ours.robot)
    lidar.set_structure(ours.structure)
    lidar.set_other("robot_b", other.robot)
    lidar.place_other("robot_b", other.transforms)
    (scan,) = lidar.add_transforms(ours.transforms)
    assert scan.member is not None
    points_m = FrameTree(ours.transforms).T_root(scan.frame).apply(scan.points_m)
    is_other = scan.member >= MEMBERS_A_ROBOT

    mpl.use("Agg")
    figure = plt.figure(figsize=(10, 6), facecolor=BACKGROUND)
    axes: Any = figure.add_axes((0, 0, 1, 1), projection="3d", facecolor=BACKGROUND, computed_zorder=False)
    for mask, colour, size in ((~is_other, STEEL, 0.3), (is_other, OTHER, 4.0)):
        axes.scatter(*points_m[mask].T, s=size, c=colour, linewidths=0)
    axes.set(xlim=(-2.1, 2.1), ylim=(-2.2, 1.2), zlim=(9.2, 11.9))
    axes.set_box_aspect((4.2, 3.4, 2.7), zoom=1.5)
    axes.view_init(**VIEW_FROM_DEG)
    axes.set_axis_off()
    axes.text2D(
        0.03, 0.93, f"{is_other.sum()} of {len(points_m)} points are on robot_b", transform=axes.transAxes, c=INK
    )
    figure.savefig(path, dpi=100, facecolor=BACKGROUND)


if __name__ == "__main__":
    main()
