"""Draws the map of a run as a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cli.report import RunReport

_VIEWS = (("from above", 0, 1), ("along y", 0, 2), ("along x", 1, 2))
_AXES = "xyz"


def draw_map(path: Path, report: RunReport) -> None:
    """A PNG with the map (coloured by height) and both trajectories, projected along each axis of the world."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 6), layout="constrained")
    points = report.map_points_m
    estimated = np.array([pose.translation for _, pose in report.estimated])
    true = np.array([pose.translation for _, pose in report.true])
    for axes, (title, i, j) in zip(figure.subplots(1, 3), _VIEWS, strict=True):
        axes.scatter(points[:, i], points[:, j], s=0.3, c=points[:, 2], cmap="viridis", linewidths=0)
        axes.plot(true[:, i], true[:, j], color="black", linewidth=2.5, label="truth")
        axes.plot(estimated[:, i], estimated[:, j], color="orangered", linewidth=1, label="estimate")
        axes.set(title=title, xlabel=f"{_AXES[i]} [m]", ylabel=f"{_AXES[j]} [m]", aspect="equal")
        axes.grid(visible=True, linewidth=0.3)
    figure.axes[0].legend(loc="upper right")
    ate_mm = report.figures["ate_rmse_m"] * 1000
    figure.suptitle(f"map of {len(points)} points in the world frame, ATE RMSE {ate_mm:.2f} mm")
    figure.savefig(path, dpi=110)
