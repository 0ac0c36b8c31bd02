"""Faces drawn into the columns of a spinning LiDAR.

The beams of a column lie in half-planes through its axis. Such a half-plane cuts a convex face in one segment: one
interval of elevations, so one run of rings. Along it 1 / range is linear in the beam's direction, and the largest wins.
Nothing falls between grid points, and moving parts cost nothing extra.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from services.sensors.lidar.beams import Beams
from services.sensors.lidar.footprint import Footprint, sub_rays
from services.sensors.rays.bodies import Bodies, bodies_of
from services.sensors.rays.interface import EdgeHits, Hits, Poses
from services.sensors.rays.kernels import kernel, part
from services.sensors.rays.lidar_edges import Room, SubRays, edge_columns, room_for, sub_ray_table
from services.sensors.rays.lidar_moving import Column, column_for, scan_columns
from services.sensors.rays.lidar_still import grid_for, scan_still
from services.sensors.rays.ring_table import RingTable, ring_table
from services.sensors.scene import Scene

Float = NDArray[np.float64]


class LidarConversion:
    """Draws scans. Convex shapes are met as solids: their inner sides only from inside or nearer than the near clip."""

    def __init__(self) -> None:
        self._placed = _Placed()
        self._beams: Beams | None = None
        self._table: RingTable
        self._body_of_face = np.empty(0, dtype=np.int32)
        self._footprint = Footprint(0.0, 0.0)
        self._sub_rays: SubRays | None = None
        self._room: Room | None = None
        self._last: Hits | None = None
        self._frames: tuple[Float, Float] | None = None
        self._poses: Poses | None = None

    def set_scene(self, scene: Scene) -> None:
        """Takes what the rays can meet."""
        bodies = bodies_of(scene)
        self._placed.set_bodies(bodies)
        self._body_of_face = np.zeros(scene.num_faces, dtype=np.int32)
        self._body_of_face[bodies.face] = np.repeat(np.arange(len(bodies.link)), np.diff(bodies.plane_start))
        self._last = self._room = None

    def scan(self, beams: Beams, poses: Poses, near_m: float, far_m: float) -> Hits:
        """The first hits between `near_m` and `far_m` along each beam.

        Raises:
            ValueError: elevations that do not fall from ring to ring.
        """
        table = self._table_of(beams)
        hits = _no_hits(beams.num_columns, len(table.ring))
        self._last = hits
        arrays = hits.range_m, hits.face, hits.cos_incidence
        if _is_even(beams, poses, table):
            bodies = self._placed.at(poses, 0)
            frame, origin_m = _axes(beams, poses)
            room = grid_for(bodies, table, beams.num_columns, float(beams.azimuth_rad[0]))
            scan_still(bodies, table, frame, origin_m, near_m, far_m, arrays, room)
            return hits
        frames, origins_m = self._frames_of(beams, poses)
        column, found = self._column_for(table)
        for block, columns in _blocks(beams, poses):
            bodies = self._placed.at(poses, block)
            hit = hits.range_m[columns], hits.face[columns], hits.cos_incidence[columns]
            scan_columns(bodies, table, frames[columns], origins_m[columns], near_m, far_m, hit, column, found)
        return hits

    def edges(self, beams: Beams, poses: Poses, near_m: float, far_m: float, footprint: Footprint) -> EdgeHits:
        """What the sub-rays meet of the beams near an edge."""
        table = self._table_of(beams)
        if footprint.exit_m == 0 and footprint.divergence_rad == 0:
            return _no_edges()
        if self._last is None or self._last.face.shape != (beams.num_columns, len(table.ring)):
            self.scan(beams, poses, near_m, far_m)
        assert self._last is not None
        rays = self._sub_rays_of(beams, footprint)
        num = 0
        room = self._room_for(table, self._last.face.size)
        column, found = self._column_for(table)
        frames, origins_m = self._frames_of(beams, poses)
        for block, columns in _blocks(beams, poses):
            bodies = self._placed.at(poses, block)
            num = edge_columns(
                bodies,
                self._body_of_face,
                table,
                rays,
                frames[columns],
                origins_m[columns],
                (near_m, far_m),
                self._last.face[columns],
                columns.start,
                column,
                found,
                room,
                num,
            )
        return EdgeHits(
            room.cells[:num].copy(), room.range_m[:num].copy(), room.face[:num].copy(), room.cos_incidence[:num].copy()
        )

    def _frames_of(self, beams: Beams, poses: Poses) -> tuple[Float, Float]:
        """Those of the columns; scan and edges ask for the same ones."""
        if self._frames is None or poses is not self._poses or beams is not self._beams:
            self._frames, self._poses = column_frames(beams, poses), poses
        return self._frames

    def _column_for(self, table: RingTable) -> tuple[Column, NDArray[np.int32]]:
        """Room for a column, and for the numbers of the bodies that it may meet."""
        return column_for(self._placed.own, len(table.ring)), np.empty(len(self._placed.own.radii_m), np.int32)

    def _room_for(self, table: RingTable, num_cells: int) -> Room:
        if self._room is None or len(self._room.cells) != num_cells:
            self._room = room_for(self._placed.own, table, num_cells)
        return self._room

    def _sub_rays_of(self, beams: Beams, footprint: Footprint) -> SubRays:
        if self._sub_rays is None or footprint != self._footprint:
            self._sub_rays, self._footprint = sub_ray_table(beams, self._table, footprint), footprint
        return self._sub_rays

    def _table_of(self, beams: Beams) -> RingTable:
        if beams is not self._beams:
            self._table, self._beams = ring_table(beams), beams
            self._sub_rays = self._room = self._frames = None
        return self._table


class _Placed:
    """The bodies in the world, moved only where their links have."""

    def __init__(self) -> None:
        self._own: Bodies | None = None
        self._world: Bodies
        self._rotation = np.empty((0, 3, 3))
        self._translation_m = np.empty((0, 3))

    def set_bodies(self, bodies: Bodies) -> None:
        self._own = bodies
        moved = {
            name: np.empty_like(getattr(bodies, name))
            for name in ("corners_m", "normals", "offsets_m", "centres_m", "half_axes_m")
        }
        self._world = bodies._replace(**moved)
        num_links = int(bodies.link.max(initial=-1)) + 1
        self._rotation = np.full((num_links, 3, 3), np.nan)
        self._translation_m = np.full((num_links, 3), np.nan)

    @property
    def own(self) -> Bodies:
        """The bodies in their links' frames."""
        if self._own is None:
            raise ValueError("set_scene comes first")
        return self._own

    def at(self, poses: Poses, block: int) -> Bodies:
        """The bodies with their links where they are in that block."""
        rotation, translation_m = poses.link_rotation[block], poses.link_translation_m[block]
        _place(self.own, self._world, rotation, translation_m, self._rotation, self._translation_m)
        self._rotation, self._translation_m = rotation, translation_m
        return self._world


@kernel
def _place(
    own: Bodies, world: Bodies, rotation: Float, translation_m: Float, last_rotation: Float, last_translation_m: Float
) -> None:
    """Moves the bodies whose links are not where they were last."""
    for b in range(len(own.link)):
        link = own.link[b]
        if _is_same(rotation, translation_m, last_rotation, last_translation_m, link):
            continue
        planes = own.plane_start[b], own.plane_start[b + 1]
        corners = own.corner_start[b], own.corner_start[b + 1]
        _move(rotation, translation_m, link, 1.0, own.corners_m, corners, world.corners_m)
        _move(rotation, translation_m, link, 1.0, own.centres_m, (b, b + 1), world.centres_m)
        _move(rotation, translation_m, link, 0.0, own.normals, planes, world.normals)
        _move(rotation, translation_m, link, 0.0, own.half_axes_m[b], (0, 3), world.half_axes_m[b])
        for p in range(planes[0], planes[1]):
            along_m = 0.0
            for i in range(3):
                along_m += world.normals[i, p] * translation_m[link, i]
            world.offsets_m[p] = own.offsets_m[p] + along_m


@part
def _is_same(rotation: Float, translation_m: Float, last_rotation: Float, last_translation_m: Float, link: int) -> bool:
    for i in range(3):
        if translation_m[link, i] != last_translation_m[link, i]:
            return False
        for j in range(3):
            if rotation[link, i, j] != last_rotation[link, i, j]:
                return False
    return True


@kernel
def _move(
    rotation: Float, translation_m: Float, link: int, share: float, columns: Float, which: tuple[int, int], out: Float
) -> None:
    """Writes columns[:, which[0]:which[1]] turned as the link is, and shifted by a share of its translation."""
    for k in range(3):
        x, y, z, shift_m = rotation[link, k, 0], rotation[link, k, 1], rotation[link, k, 2], translation_m[link, k]
        for i in range(np.uint64(which[0]), np.uint64(which[1])):
            out[k, i] = x * columns[0, i] + y * columns[1, i] + z * columns[2, i] + share * shift_m


def column_frames(beams: Beams, poses: Poses) -> tuple[Float, Float]:
    """Of each column the axes outward along the encoder, to the left and up (C, 3, 3), and the beams' origin (C, 3)."""
    num_columns, encoder = beams.num_columns, beams.encoder_rad
    R, t = poses.sensor_rotation, poses.sensor_translation_m
    axes = (R @ beams.T_sensor_lidar.rotation).transpose(0, 2, 1)
    cos, sin = np.cos(encoder)[:, np.newaxis], np.sin(encoder)[:, np.newaxis]
    frames = np.empty((num_columns, 3, 3))
    frames[:, 0] = cos * axes[:, 0] + sin * axes[:, 1]
    frames[:, 1] = cos * axes[:, 1] - sin * axes[:, 0]
    frames[:, 2] = axes[:, 2]
    origins_m = R @ beams.T_sensor_lidar.translation + t + beams.origin_m * frames[:, 0]
    return frames, origins_m


def _axes(beams: Beams, poses: Poses) -> tuple[Float, Float]:
    """The axes in which the beams of a sensor at rest turn, as rows, and where they begin."""
    R, t = poses.sensor_rotation[0], poses.sensor_translation_m[0]
    frame = np.ascontiguousarray((R @ beams.T_sensor_lidar.rotation).T)
    return frame, R @ beams.T_sensor_lidar.translation + t


def _is_even(beams: Beams, poses: Poses, table: RingTable) -> bool:
    is_still = len(poses.sensor_rotation) == len(poses.link_rotation) == 1
    is_one_group = len(table.spread) == 1 and table.spread[0] == 0.0
    return is_still and is_one_group and beams.origin_m == 0.0


def _blocks(beams: Beams, poses: Poses) -> list[tuple[int, slice]]:
    """Numbers of the blocks of columns that have any, and which columns those are."""
    num_blocks = len(poses.link_rotation)
    starts = [-(-block * beams.num_columns // num_blocks) for block in range(num_blocks + 1)]
    return [(block, slice(a, b)) for block, (a, b) in enumerate(pairwise(starts)) if a < b]


def _no_hits(num_columns: int, num_rings: int) -> Hits:
    shape = num_columns, num_rings
    return Hits(np.empty(shape, np.float32), np.empty(shape, np.int32), np.empty(shape, np.float32))


def _no_edges() -> EdgeHits:
    shape = 0, len(sub_rays())
    return EdgeHits(
        np.empty(0, np.int64), np.empty(shape, np.float32), np.empty(shape, np.int32), np.empty(shape, np.float32)
    )
