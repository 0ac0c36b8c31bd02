"""The page's 3D view: robot, structure, scan, map and planes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import matplotlib
import numpy as np
import viser
from numpy.typing import NDArray

from services.teleop.bodies import Body, height_shades, thinned
from services.teleop.teleop import Teleop
from shared.errors import MessageError
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
from shared.messaging.messages import Foot, LegState, LidarScan, Message, PlaneMap, PointCloud, Transforms
from shared.robot.kinematics import FOOT_LINKS

LAYERS = ("robot", "structure", "scan", "map", "planes")
HIDDEN = ("planes",)
"""Layers that are not seen before somebody asks: outlines of planes cover much of the view."""
M = TypeVar("M", bound=Message)

_FIXED_COLOUR = (255, 140, 26)
_MAX_SHADE_M = 6.0
"""Ranges beyond this have the last colour: what is near matters on a climb."""
_POINT_SIZE_M = 0.008
_MAP_FRAME = "map"
_WORLD = "world"


class Scene:
    """Draws what the robot says; each layer is a frame below which its parts are."""

    def __init__(self, server: viser.ViserServer, max_points: int) -> None:
        self._server, self._scene = server, server.scene
        self._max_points = max_points
        self._scene.set_up_direction("+z")
        self._scene.configure_default_lights(cast_shadow=False)  # shadows cost more than all else
        self._layers = {layer: self._scene.add_frame(f"/{layer}", show_axes=False) for layer in LAYERS}
        self._links: dict[str, viser.FrameHandle] = {}
        self._feet: dict[Foot, list[tuple[viser.MeshHandle, tuple[int, int, int]]]] = {foot: [] for foot in Foot}
        self._drawn: dict[type[Message], Message] = {}
        self._is_shown = dict.fromkeys(LAYERS, True)
        self._ranges = _lut("turbo_r")
        self._heights = _lut("Blues_r")
        self._num_planes = 0

    def draw_robot(self, bodies: Sequence[Body]) -> None:
        """Draws the robot's links, each in a frame of its own."""
        links = {FOOT_LINKS[foot]: foot for foot in Foot}
        for number, body in enumerate(bodies):
            if body.link not in self._links:
                self._links[body.link] = self._scene.add_frame(f"/robot/{body.link}", show_axes=False)
            mesh = self._add_mesh(f"/robot/{body.link}/{number}", body)
            if body.link in links:
                self._feet[links[body.link]].append((mesh, body.colour))

    def draw_structure(self, bodies: Sequence[Body]) -> None:
        """Draws the structure and its ground, which stand still in the world."""
        for number, body in enumerate(bodies):
            self._add_mesh(f"/structure/{number}", body)

    def show(self, teleop: Teleop, visible: dict[str, bool]) -> None:
        """Draws what is new since the last call. visible: of each layer."""
        for layer in LAYERS:
            if self._is_shown[layer] != visible[layer]:
                self._layers[layer].visible = self._is_shown[layer] = visible[layer]
        with self._server.atomic():
            if (transforms := self._new(teleop, Transforms)) is not None:
                self._pose_robot(transforms)
            if (leg := self._new(teleop, LegState)) is not None:
                self._mark_fixed_foot(leg.fixed_foot)

    def show_clouds(self, teleop: Teleop, T_world_map: SE3 | None) -> None:
        """Draws scan, map and planes where they are new; dearer than `show`, to be called less often."""
        with self._server.atomic():
            transforms = teleop.newest(Transforms)
            if self._is_shown["scan"] and transforms and (scan := self._new(teleop, LidarScan)) is not None:
                self._draw_scan(scan, transforms)
            if T_world_map is None:
                return
            for layer in ("map", "planes"):
                _place(self._layers[layer], T_world_map)
            if self._is_shown["map"] and (cloud := self._new(teleop, PointCloud)) is not None:
                self._draw_map(cloud)
            if self._is_shown["planes"] and (planes := self._new(teleop, PlaneMap)) is not None:
                self._draw_planes(planes)

    def _new(self, teleop: Teleop, kind: type[M]) -> M | None:
        message = teleop.newest(kind)
        if message is None or message is self._drawn.get(kind):
            return None
        self._drawn[kind] = message
        return message

    def _pose_robot(self, transforms: Transforms) -> None:
        tree = FrameTree(transforms)
        for link, frame in self._links.items():
            T_world_link = _pose(tree, link)
            if T_world_link is not None:
                _place(frame, T_world_link)

    def _mark_fixed_foot(self, fixed_foot: Foot) -> None:
        for foot, meshes in self._feet.items():
            for mesh, colour in meshes:
                mesh.color = _FIXED_COLOUR if foot is fixed_foot else colour

    def _draw_scan(self, scan: LidarScan, transforms: Transforms) -> None:
        T_world_sensor = _pose(FrameTree(transforms), scan.frame)
        if T_world_sensor is None or not len(scan.points_m):
            return
        points_m = thinned(scan.points_m, self._max_points)
        shades = np.linalg.norm(points_m, axis=1) / _MAX_SHADE_M
        self._add_cloud("/scan/points", points_m, self._ranges, shades)
        _place(self._layers["scan"], T_world_sensor)

    def _draw_map(self, cloud: PointCloud) -> None:
        if len(cloud.points_m):
            points_m = thinned(cloud.points_m, self._max_points)
            self._add_cloud("/map/points", points_m, self._heights, height_shades(points_m))

    def _draw_planes(self, plane_map: PlaneMap) -> None:
        for number, plane in enumerate(plane_map.planes):
            corners = plane.outline_m
            fan = np.array([(0, i, i + 1) for i in range(1, len(corners) - 1)], dtype=np.uint32).reshape(-1, 3)
            red, green, blue = (round(255 * part) for part in plane.colour.tolist())
            self._scene.add_mesh_simple(
                f"/planes/{number}",
                corners,
                fan,
                color=(red, green, blue),
                opacity=0.35,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
        for number in range(len(plane_map.planes), self._num_planes):
            self._scene.remove_by_name(f"/planes/{number}")
        self._num_planes = len(plane_map.planes)

    def _add_mesh(self, name: str, body: Body) -> viser.MeshHandle:
        return self._scene.add_mesh_simple(
            name,
            body.vertices_m,
            body.triangles,
            color=body.colour,
            flat_shading=body.is_flat,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _add_cloud(
        self,
        name: str,
        points_m: NDArray[np.float32],
        lut: NDArray[np.uint8],
        shades: NDArray[np.floating],
    ) -> None:
        colours = lut[np.clip(255 * shades, 0, 255).astype(np.uint8)]
        self._scene.add_point_cloud(
            name, points_m, colours, point_size=_POINT_SIZE_M, point_shape="circle", precision="float32"
        )


def T_world_map_of(static: Transforms | None) -> SE3 | None:
    """Where the map's frame is in the world, as the evaluator says; None before it does."""
    return None if static is None else _pose(FrameTree(static), _MAP_FRAME)


def _pose(tree: FrameTree, frame: str) -> SE3 | None:
    try:
        return tree.T_root(frame)
    except MessageError:
        return None


def _place(frame: viser.FrameHandle, T: SE3) -> None:
    xyz_quat_xyzw = T.xyz_quat_xyzw
    frame.position = xyz_quat_xyzw[:3]
    frame.wxyz = xyz_quat_xyzw[[6, 3, 4, 5]]


def _lut(name: str) -> NDArray[np.uint8]:
    colours: NDArray[np.uint8] = (255 * matplotlib.colormaps[name](np.arange(256))[:, :3]).astype(np.uint8)
    return colours
