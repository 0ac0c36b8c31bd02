"""The planes of a cloud in colours, all other points black: as a picture, and as colours for a file."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared.cloud_planes import CloudPlane

Colours = NDArray[np.uint8]
Float = NDArray[np.float64]

_GOLDEN_TURN = 0.61803398875
"""Hues so far apart stay distinct for any number of them."""
_MAX_DRAWN = 200_000
_AZIMUTH_RAD, _ELEVATION_RAD = np.deg2rad(-58.0), np.deg2rad(24.0)


def plane_colour(number: int) -> tuple[int, int, int]:
    """Red, green, blue of the plane of that number."""
    red, green, blue = colorsys.hsv_to_rgb(number * _GOLDEN_TURN % 1.0, 0.85, 0.9 if number % 2 == 0 else 0.65)
    return round(255 * red), round(255 * green), round(255 * blue)


def colours_of(num_points: int, planes: Sequence[CloudPlane]) -> Colours:
    """Colours (N, 3) of all points, black where they are on no plane."""
    colours = np.zeros((num_points, 3), dtype=np.uint8)
    for number, plane in enumerate(planes):
        colours[plane.rows] = plane_colour(number)
    return colours


def draw_planes(path: Path, points_m: Float, planes: Sequence[CloudPlane], title: str) -> None:
    """A PNG with the cloud seen obliquely without perspective, and from above; the largest planes are named."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    step = max(1, -(-len(points_m) // _MAX_DRAWN))
    shown_m, colours = points_m[::step], colours_of(len(points_m), planes)[::step] / 255
    figure = Figure(figsize=(16, 8), layout="constrained")
    for axes, view in zip(figure.subplots(1, 2), (_oblique(), np.eye(3)), strict=True):
        seen = shown_m @ view.T
        order = np.argsort(seen[:, 2])
        axes.scatter(seen[order, 0], seen[order, 1], s=1.0, c=colours[order], linewidths=0)
        axes.set_aspect("equal")
    oblique, above = figure.axes
    oblique.axis("off")
    above.set(title="from above", xlabel="x [m]", ylabel="y [m]")
    above.grid(visible=True, linewidth=0.3)
    marks = [
        Line2D([], [], linestyle="", marker="o", color=_unit(plane_colour(number)), label=_label(plane))
        for number, plane in enumerate(planes[:20])
    ]
    if marks:
        figure.legend(handles=marks, loc="outside left upper", fontsize=8, title="normal, distance, points")
    figure.suptitle(title)
    figure.savefig(path, dpi=110)


def _unit(colour: tuple[int, int, int]) -> tuple[float, float, float]:
    red, green, blue = colour
    return red / 255, green / 255, blue / 255


def _label(plane: CloudPlane) -> str:
    x, y, z, d = plane.coefficients.tolist()
    return f"{x:+.2f} {y:+.2f} {z:+.2f}  {d:+.3f} m  {len(plane.rows)}"


def _oblique() -> Float:
    """Unit vectors right, up and towards the viewer as rows."""
    a, e = _AZIMUTH_RAD, _ELEVATION_RAD
    to_viewer = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.array([right, np.cross(to_viewer, right), to_viewer])
