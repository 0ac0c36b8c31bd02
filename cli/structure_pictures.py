"""Draws a structure: seen obliquely, and projected along each axis of the world, hidden surfaces left out."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shared.solids import Mesh
from shared.world.mesh_format import world_mesh
from shared.world.structure import Structure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Float = NDArray[np.float64]

_AXES = "xyz"
_AXIS_COLOURS = ("#c0392b", "#1e8449", "#2471a3")
_NUM_PIXELS, _NUM_PIXELS_OBLIQUE = 900, 1400
"""Along the longer side of a view; drawn smaller, which smooths its edges."""
_LIGHT = np.array([0.35, 0.55, 0.75])
"""Where the light comes from: right, up, and from behind the viewer."""
_STEEL, _EDGE = np.array([0.62, 0.68, 0.74]), np.array([0.16, 0.19, 0.22])
_EDGE_COSINE = 0.95
"""Where neighbouring normals differ more than by this cosine there is an edge."""
_EDGE_DEPTH = 0.004
"""Where depths jump by more than this part of the view there is an edge."""
_AZIMUTH_RAD, _ELEVATION_RAD = np.deg2rad(-58.0), np.deg2rad(24.0)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One look without perspective: `axes` has the unit vectors right, up and towards the viewer as rows."""

    title: str
    axes: Float
    labels: str = ""


def draw_structure(path: Path, structure: Structure, summary: str) -> None:
    """A PNG with four views of the structure and the summary beside them; metres in the world frame."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib.figure import Figure

    mesh = world_mesh(structure)
    size = np.clip(np.ptp(mesh.vertices_m, axis=0), 1e-9, None)
    x, y, z = np.maximum(size / size.max(), 0.3).tolist()
    figure = Figure(figsize=(16, 9), layout="constrained")
    panels = figure.subplot_mosaic(
        [["oblique", "above", "text"], ["oblique", "front", "side"]],
        width_ratios=[1.15 * (x + y), x, y],
        height_ratios=[y, z],
    )
    scene = _Scene(mesh)
    for panel, view in zip(("oblique", "above", "front", "side"), _views(), strict=True):
        _draw_view(panels[panel], view, scene, structure.ground_z_m)
    panels["text"].axis("off")
    panels["text"].text(0.02, 0.98, summary, va="top", fontsize=10, linespacing=1.6)
    figure.savefig(path, dpi=110)


def _views() -> list[View]:
    a, e = _AZIMUTH_RAD, _ELEVATION_RAD
    to_viewer = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    x, y, z = np.eye(3)
    return [
        View("", np.array([right, np.cross(to_viewer, right), to_viewer])),
        View("from above", np.array([x, y, z]), "xy"),
        View("along y", np.array([x, z, -y]), "xz"),
        View("along -x", np.array([y, z, x]), "yz"),
    ]


class _Scene:
    """The triangles of a mesh, and what a bundle of parallel rays sees of them."""

    def __init__(self, mesh: Mesh) -> None:
        o3d: Any = import_module("open3d")
        self.vertices_m = mesh.vertices_m
        self._centre = (mesh.vertices_m.max(axis=0) + mesh.vertices_m.min(axis=0)) / 2
        self._radius = float(np.linalg.norm(mesh.vertices_m - self._centre, axis=1).max()) + 1e-9
        self._tensor: Any = o3d.core.Tensor
        self._scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        centred = (mesh.vertices_m - self._centre).astype(np.float32)
        self._scene.add_triangles(self._tensor(centred), self._tensor(np.ascontiguousarray(mesh.triangles)))

    def image(self, axes: Float, bounds: Float, num_pixels: int) -> Float:
        """The picture (H, W, 4) of what lies in `bounds` [[right low, high], [up low, high]], top row first."""
        spans = np.ptp(bounds, axis=1)
        width, height = np.maximum(spans / spans.max() * num_pixels, 2).astype(int)
        right, up = np.meshgrid(_centres(bounds[0], width), _centres(bounds[1], height)[::-1])
        right, up = right - axes[0] @ self._centre, up - axes[1] @ self._centre
        starts = right[..., np.newaxis] * axes[0] + up[..., np.newaxis] * axes[1] + 2 * self._radius * axes[2]
        rays = np.concatenate([starts, np.broadcast_to(-axes[2], starts.shape)], axis=-1).astype(np.float32)
        met = self._scene.cast_rays(self._tensor(rays), nthreads=1)
        return _shaded(met["t_hit"].numpy() / (2 * self._radius), met["primitive_normals"].numpy() @ axes.T)


def _centres(bounds: Float, count: int) -> Float:
    edges = np.linspace(bounds[0], bounds[1], count + 1)
    return (edges[:-1] + edges[1:]) / 2


def _shaded(depth: Float, normals: Float) -> Float:
    """Steel in the light with dark edges, transparent where nothing is; depth in views, normals in the view's axes."""
    is_steel = np.isfinite(depth)
    normals = normals * np.where(normals[..., 2:] < 0, -1.0, 1.0)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    brightness = 0.45 + 0.6 * np.clip(normals @ light, 0, 1)
    depth = np.where(is_steel, depth, 2.0)
    is_edge = np.zeros_like(is_steel)
    for axis in (0, 1):
        turns = np.sum(normals * np.roll(normals, 1, axis), axis=-1) < _EDGE_COSINE
        is_edge |= (turns & is_steel & np.roll(is_steel, 1, axis)) | (
            np.abs(depth - np.roll(depth, 1, axis)) > _EDGE_DEPTH
        )
    colour: Float = np.where(is_edge[..., np.newaxis], _EDGE, np.clip(brightness[..., np.newaxis] * _STEEL, 0, 1))
    return np.concatenate([colour, (is_steel | is_edge)[..., np.newaxis].astype(np.float64)], axis=-1)


def _draw_view(panel: Axes, view: View, scene: _Scene, ground_z_m: float | None) -> None:
    seen = scene.vertices_m @ view.axes[:2].T
    margin = 0.04 * np.ptp(seen, axis=0).max() + 1e-9
    bounds = np.stack([seen.min(axis=0) - margin, seen.max(axis=0) + margin], axis=1)
    image = scene.image(view.axes, bounds, _NUM_PIXELS if view.labels else _NUM_PIXELS_OBLIQUE)
    if not view.labels:
        panel.imshow(image, extent=(*bounds[0], *bounds[1]), interpolation="antialiased")
        panel.axis("off")
        _draw_axes(panel, view, bounds)
        return
    panel.imshow(image, extent=(*bounds[0], *bounds[1]), interpolation="antialiased", zorder=2)
    panel.set(title=view.title, xlabel=f"{view.labels[0]} [m]", ylabel=f"{view.labels[1]} [m]", aspect="equal")
    panel.grid(visible=True, linewidth=0.3)
    if view.labels[1] == "z" and ground_z_m is not None and bounds[1][0] <= ground_z_m <= bounds[1][1]:
        panel.axhline(ground_z_m, color="saddlebrown", linewidth=1.5)


def _draw_axes(panel: Axes, view: View, bounds: Float) -> None:
    """The world's axes as arrows in the lower left corner."""
    length = 0.07 * np.ptp(bounds, axis=1).max()
    start = bounds[:, 0] + 0.5 * length
    for axis, (letter, colour) in enumerate(zip(_AXES, _AXIS_COLOURS, strict=True)):
        along = length * view.axes[:2, axis]
        panel.annotate("", start + along, start, arrowprops={"arrowstyle": "->", "color": colour, "linewidth": 1.5})
        x, y = (start + 1.25 * along).tolist()
        panel.text(x, y, letter, color=colour, ha="center", va="center")
