"""Draws an evaluation: the trajectories, their errors over time, how far map points are from steel."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from cli.evaluation import Evaluation

_VIEWS = (("from above", 0, 1), ("along y", 0, 2))
_AXES = "xyz"
_NUM_BINS = 100


def draw_evaluation(folder: Path, result: Evaluation) -> None:
    """Writes trajectory.png and errors.png, and map_distances.png where there is a map."""
    import matplotlib as mpl

    mpl.use("Agg")
    _draw_trajectory(folder / "trajectory.png", result)
    _draw_errors(folder / "errors.png", result)
    if result.distances_m is not None:
        _draw_distances(folder / "map_distances.png", result)


def _draw_trajectory(path: Path, result: Evaluation) -> None:
    from matplotlib.figure import Figure

    estimated = np.array([pose.translation for _, pose in result.estimated])
    true = np.array([pose.translation for _, pose in result.true])
    figure = Figure(figsize=(13, 6), layout="constrained")
    for axes, (title, i, j) in zip(figure.subplots(1, 2), _VIEWS, strict=True):
        if (points := result.map_points_m) is not None:
            axes.scatter(points[:, i], points[:, j], s=0.2, color="0.75", linewidths=0)
        axes.plot(true[:, i], true[:, j], color="black", linewidth=2.5, label="truth")
        axes.plot(estimated[:, i], estimated[:, j], color="orangered", linewidth=1, label="estimate")
        axes.set(title=title, xlabel=f"{_AXES[i]} [m]", ylabel=f"{_AXES[j]} [m]", aspect="equal")
        axes.grid(visible=True, linewidth=0.3)
    figure.axes[0].legend(loc="upper right")
    figure.suptitle(f"{len(true)} poses in the world, ATE RMSE {result.figures['ate_rmse_m'] * 1000:.2f} mm")
    figure.savefig(path, dpi=110)


def _draw_errors(path: Path, result: Evaluation) -> None:
    from matplotlib.figure import Figure

    times_s = np.array([stamp_ns for stamp_ns, _ in result.true]) / 1e9
    figure = Figure(figsize=(10, 6), layout="constrained")
    rows = (("position [mm]", result.errors[:, 0] * 1000), ("rotation [deg]", np.degrees(result.errors[:, 1])))
    for axes, (label, values) in zip(figure.subplots(2, 1, sharex=True), rows, strict=True):
        axes.plot(times_s, values, color="orangered", linewidth=1, marker=".", markersize=3)
        axes.set(ylabel=label, ylim=(0, None))
        axes.grid(visible=True, linewidth=0.3)
    figure.axes[-1].set_xlabel("time [s]")
    figure.suptitle("error of the estimate against the truth")
    figure.savefig(path, dpi=110)


def _draw_distances(path: Path, result: Evaluation) -> None:
    from matplotlib.figure import Figure

    assert result.distances_m is not None
    distances_mm = result.distances_m * 1000
    shown_mm = max(float(np.percentile(distances_mm, 99)), 1e-3)
    figure = Figure(figsize=(10, 5), layout="constrained")
    axes = figure.subplots()
    axes.hist(np.minimum(distances_mm, shown_mm), bins=_NUM_BINS, range=(0, shown_mm), color="steelblue")
    for key, label in (("map_accuracy_mean_m", "mean"), ("map_accuracy_p95_m", "95 %")):
        value_mm = result.figures[key] * 1000
        axes.axvline(value_mm, color="black", linewidth=1)
        axes.text(value_mm, axes.get_ylim()[1], f" {label} {value_mm:.2f}", va="top")
    axes.set(xlabel="distance to the nearest steel [mm]; the last bar holds all beyond", ylabel="map points")
    figure.suptitle(f"{len(distances_mm)} map points")
    figure.savefig(path, dpi=110)
