"""Where steel is under a sole: the question that every landing and every hold asks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.robot.kinematics import HYRECRO
from shared.world.structure import Structure

Float = NDArray[np.float64]

_NUM_SAMPLES_A_SIDE = 5
_INSET_M = 0.0005
"""The outermost samples keep this far inside the sole's edge, so that a bar just as wide as the sole counts whole."""
_MIN_FACING = 0.5
"""Cosine between sole and face: what is turned by more than 60 degrees is no floor for a foot."""


@dataclass(frozen=True, slots=True)
class SoleContact:
    """What is under a sole within reach.

    gap_m: from the sole down to the steel along the sole's normal, at its worst sample: the one that is farthest from
    the face, above (positive) or sunk in (negative); inf where there is no steel at all. angle_rad: between the normals
    of sole and steel, at its largest; pi where there is none. coverage: share of the sole over steel, 0..1. members:
    names of the members below, sorted.
    """

    gap_m: float
    angle_rad: float
    coverage: float
    members: tuple[str, ...]

    def is_flush(self, max_gap_m: float, max_angle_rad: float) -> bool:
        """Whether the whole sole is over steel, within this gap or depth and this angle."""
        return self.coverage == 1.0 and abs(self.gap_m) <= max_gap_m and self.angle_rad <= max_angle_rad


class SteelSurface:
    """The surface of a structure, for questions about places on it. Coordinates are in the world's frame."""

    def __init__(self, structure: Structure) -> None:
        meshes = [mesh_of(member.solid).moved(member.T_world_member) for member in structure.members]
        corners = [mesh.vertices_m.astype(np.float64)[mesh.triangles] for mesh in meshes]
        self._corners: Float = np.concatenate([np.empty((0, 3, 3)), *corners])
        self._names = [member.name for member in structure.members]
        self._member = np.repeat(np.arange(len(corners)), [len(triangles) for triangles in corners])
        self._low, self._high = self._corners.min(axis=1), self._corners.max(axis=1)
        across = np.cross(self._corners[:, 1] - self._corners[:, 0], self._corners[:, 2] - self._corners[:, 0])
        self._normals: Float = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)

    def under_sole(self, T_world_foot: SE3, reach_m: float = 0.02) -> SoleContact:
        """What is within `reach_m` above and below the sole of a foot whose plate's centre is there."""
        origins = T_world_foot.apply(_sole_samples())
        up = T_world_foot.rotation[:, 2]
        triangle, gap_m = self._first_below(origins + reach_m * up, -up, 2 * reach_m)
        is_met = triangle >= 0
        if not is_met.any():
            return SoleContact(np.inf, np.pi, 0.0, ())
        gaps_m = gap_m[is_met] - reach_m
        cosines = self._normals[triangle[is_met]] @ up
        names = {self._names[i] for i in self._member[triangle[is_met]].tolist()}
        return SoleContact(
            gap_m=float(gaps_m[np.argmax(np.abs(gaps_m))]),
            angle_rad=float(np.arccos(np.clip(cosines.min(), -1.0, 1.0))),
            coverage=float(is_met.mean()),
            members=tuple(sorted(names)),
        )

    def flush_pose(self, T_world_foot: SE3, reach_m: float = 0.02) -> SE3 | None:
        """The pose nearest to this one in which the sole lies flush on the steel below; None where there is none."""
        origins = T_world_foot.apply(_sole_samples())
        up = T_world_foot.rotation[:, 2]
        triangle, depth_m = self._first_below(origins + reach_m * up, -up, 2 * reach_m)
        if (triangle < 0).any():
            return None
        middle = len(triangle) // 2
        normal = self._normals[triangle[middle]]
        axis = np.cross(up, normal)
        sine = float(np.linalg.norm(axis))
        turn = np.zeros(3) if sine < 1e-15 else axis / sine * np.arctan2(sine, up @ normal)
        rotation = SE3.exp([0, 0, 0, *turn]).rotation @ T_world_foot.rotation
        touch = origins[middle] + (reach_m - depth_m[middle]) * up
        return SE3(rotation, touch + HYRECRO.sole_below_plate_m * rotation[:, 2])

    def distance_m(self, T_world_foot: SE3) -> float:
        """From the centre of the foot's sole to the nearest steel, in any direction; inf where there is no steel."""
        point = T_world_foot.apply(HYRECRO.T_foot_sole.translation)
        away = np.maximum(np.maximum(self._low - point, point - self._high), 0)
        bound = np.linalg.norm(away, axis=1)
        best = np.inf
        for rows in np.array_split(np.argsort(bound), len(bound) // 64 + 1):
            if not len(rows) or bound[rows[0]] >= best:
                break
            best = min(best, float(_point_distances(point, self._corners[rows], self._normals[rows]).min()))
        return best

    def _first_below(self, origins: Float, direction: Float, reach_m: float) -> tuple[NDArray[np.int64], Float]:
        """The first triangle that faces each ray (N, 3) within reach, -1 where none, and how far it is (N,)."""
        ends = np.concatenate([origins, origins + reach_m * direction])
        is_near = (self._low <= ends.max(axis=0)).all(axis=1) & (self._high >= ends.min(axis=0)).all(axis=1)
        near = np.flatnonzero(is_near & (self._normals @ direction < -_MIN_FACING))
        distance = np.full((len(origins), len(near) + 1), np.inf)
        distance[:, 1:] = _ray_distances(origins, direction, self._corners[near])
        distance[distance > reach_m] = np.inf
        first = distance.argmin(axis=1)
        return np.concatenate([[-1], near])[first], distance[np.arange(len(origins)), first]


def _sole_samples() -> Float:
    """Points (25, 3) of the sole in the foot's frame; the middle one is its centre."""
    side = np.linspace(-1, 1, _NUM_SAMPLES_A_SIDE) * (HYRECRO.sole_half_width_m - _INSET_M)
    x, y = np.meshgrid(side, side)
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -HYRECRO.sole_below_plate_m)])


def _ray_distances(origins: Float, direction: Float, corners: Float) -> Float:
    """Distances (N, T) along a direction from origins (N, 3) to triangles (T, 3, 3), inf where missed.

    Source: Moeller and Trumbore, Fast minimum storage ray/triangle intersection, 1997.
    """
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(direction, edge2)
    determinant = np.einsum("tc,tc->t", edge1, p)
    s = origins[:, np.newaxis] - corners[:, 0]
    u = np.einsum("ntc,tc->nt", s, p) / determinant
    q = np.cross(s, edge1)
    v = (q @ direction) / determinant
    distance = np.einsum("ntc,tc->nt", q, edge2) / determinant
    seam = 1e-9  # neighbours share their edge: a ray along it must meet one of them
    is_inside = (u >= -seam) & (v >= -seam) & (u + v <= 1 + seam) & (distance >= 0)
    return np.where(is_inside, distance, np.inf)


def _point_distances(point: NDArray[np.floating], corners: Float, normals: Float) -> Float:
    """Distances (T,) from a point (3,) to triangles (T, 3, 3) of unit normals (T, 3)."""
    from_corner = point - corners
    edges = np.roll(corners, -1, axis=1) - corners
    share = (from_corner * edges).sum(axis=2) / np.maximum((edges**2).sum(axis=2), 1e-300)
    to_edges = np.linalg.norm(from_corner - np.clip(share, 0, 1)[..., None] * edges, axis=2).min(axis=1)
    inwards = np.cross(normals[:, None], edges)
    is_above = ((from_corner * inwards).sum(axis=2) >= 0).all(axis=1)
    height = np.abs((from_corner[:, 0] * normals).sum(axis=1))
    distances: Float = np.where(is_above, height, to_edges)
    return distances
