"""Where the robot cuts into steel or into itself, and how deep."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared.climbing.bodies import Bodies, bodies_of
from shared.climbing.convex import Zonotopes, depths, depths_in_faces, stacked, zonotope
from shared.climbing.stance import Stance
from shared.geometry import SE3, Float
from shared.robot.description import UrdfModel
from shared.robot.kinematics import FOOT_LINKS, LINKS
from shared.solids import Box, Mesh
from shared.world.structure import Member, Structure

Index = NDArray[np.int64]

REACH_M = 1.2
"""No point of the robot is ever farther than this from its fixed foot: both legs at full length, hip and sensor."""
_GROUND_M = 1e4
"""The ground's edge: beyond any structure."""
_ROUNDING_M = 1e-9
"""What touches may cut in by this: rounding of poses in the world."""


@dataclass(frozen=True, slots=True, eq=False)
class Contacts:
    """The deepest pair of each posture: depth_m (S,), negative where it is only near, -inf where nothing is near.

    link, other: names (S,) of the robot's link and of the member or other link; empty where nothing is near.
    """

    depth_m: Float
    link: tuple[str, ...]
    other: tuple[str, ...]

    def deepest(self) -> int:
        """The posture with the deepest contact."""
        return int(self.depth_m.argmax())


@dataclass(frozen=True, slots=True, eq=False)
class _Obstacles:
    """Solids of one kind (J), or triangles where `corners` is given: bounds (J, 3), index of the member (J,)."""

    low: Float
    high: Float
    member: Index
    solids: Zonotopes | None = None
    corners: Float | None = None
    normals: Float | None = None

    def near(self, low: Float, high: Float) -> _Obstacles:
        """Those whose bounds meet the box low..high."""
        rows = np.flatnonzero((self.low <= high).all(axis=1) & (self.high >= low).all(axis=1))
        parts = [None if part is None else part[rows] for part in (self.corners, self.normals)]
        solids = None if self.solids is None else self.solids.at(rows)
        return _Obstacles(self.low[rows], self.high[rows], self.member[rows], solids, *parts)

    def depths_of(self, bodies: Zonotopes, rows: Index) -> Float:
        """Of pairs (N): bodies (N) in the obstacles of these rows (N,)."""
        if self.solids is not None:
            return depths(bodies, self.solids.at(rows))
        assert self.corners is not None
        assert self.normals is not None
        return depths_in_faces(bodies, self.corners[rows], self.normals[rows])


class CollisionModel:
    """The robot's bodies, the structure's members and the ground; bars and tubes are solid, meshes are their faces.

    Two links are not checked against each other where they are rigid with each other or joined by a joint.

    Raises:
        InputFileError: the robot's collision shapes are not usable.
    """

    def __init__(self, model: UrdfModel, structure: Structure) -> None:
        self.bodies = bodies_of(model)
        members = (*structure.members, *_ground(structure))
        self.members = tuple(member.name for member in members)
        self._obstacles = tuple(_obstacles_of(members))

    def around(self, stance: Stance) -> Surroundings:
        """What can be touched from where the robot stands."""
        origin = stance.T_world_foot.translation
        near = tuple(kind.near(origin - REACH_M, origin + REACH_M) for kind in self._obstacles)
        return Surroundings(stance, self.bodies, near, self.members)


class Surroundings:
    """The collisions of a robot that stands somewhere, with what is within its reach.

    Its fixed foot is not checked against members: it does not move, and what is under it was judged when it landed.
    """

    def __init__(
        self, stance: Stance, bodies: tuple[Bodies, ...], obstacles: tuple[_Obstacles, ...], members: tuple[str, ...]
    ) -> None:
        self.stance = stance
        self._bodies = bodies
        self._obstacles = obstacles
        self._names = (*members, *(name for kind in bodies for name in kind.names))
        fixed = LINKS.index(FOOT_LINKS[stance.fixed_foot])
        self._movable = [np.flatnonzero(kind.chain != fixed) for kind in bodies]

    def contacts(self, q: ArrayLike, near_m: float = 0.0) -> Contacts:
        """The deepest contact of each posture q (S, 8); up to `near_m` apart counts as near."""
        T_world_links = self.stance.T_world_links(q)
        placed = [kind.placed(T_world_links) for kind in self._bodies]
        found = [*self._with_members(placed, near_m), *self._with_itself(placed, near_m)]
        posture, body, other, depth_m = (np.concatenate(column) for column in zip(*found, strict=True))
        order = np.lexsort((depth_m, posture))
        posture, body, other, depth_m = (column[order] for column in (posture, body, other, depth_m))
        is_last = np.append(posture[1:] != posture[:-1], True)[: len(posture)]
        num = len(T_world_links)
        best = np.full(num, -np.inf)
        names = np.full((2, num), -1)
        best[posture[is_last]] = depth_m[is_last]
        names[:, posture[is_last]] = body[is_last], other[is_last]
        link, touched = (tuple("" if i < 0 else self._names[i] for i in row) for row in names.tolist())
        return Contacts(best, link, touched)

    def is_free(self, q: ArrayLike, margin_m: float = 0.0) -> NDArray[np.bool_]:
        """Whether each posture q (S, 8) keeps this distance; touching is free where it is 0."""
        free: NDArray[np.bool_] = self.contacts(q, margin_m).depth_m <= -margin_m + _ROUNDING_M
        return free

    def _with_members(self, placed: list[Zonotopes], near_m: float) -> Iterator[tuple[Index, Index, Index, Float]]:
        first = len(self._names) - sum(len(kind.names) for kind in self._bodies)
        for kind, movable, solids in zip(self._bodies, self._movable, placed, strict=True):
            bodies = solids.at((slice(None), movable))
            reach = bodies.reach() + near_m + _ROUNDING_M
            low, high = bodies.centres - reach, bodies.centres + reach
            for obstacles in self._obstacles:
                is_near = _overlap(low[:, :, None], high[:, :, None], obstacles.low, obstacles.high)
                s, k, j = np.nonzero(is_near)
                depth_m = obstacles.depths_of(bodies.at((s, k)), j)
                keep = depth_m > -near_m - _ROUNDING_M
                yield s[keep], first + movable[k[keep]], obstacles.member[j[keep]], depth_m[keep]
            first += len(kind.names)

    def _with_itself(self, placed: list[Zonotopes], near_m: float) -> Iterator[tuple[Index, Index, Index, Float]]:
        starts = len(self._names) - np.cumsum([len(kind.names) for kind in self._bodies][::-1])[::-1]
        for i, a in enumerate(self._bodies):
            for j, b in enumerate(self._bodies[i:], start=i):
                is_pair = np.abs(a.chain[:, None] - b.chain) > 1
                first, second = np.nonzero(np.triu(is_pair) if i == j else is_pair)
                s, rows = np.nonzero(_bounds_meet(placed[i], placed[j], first, second, near_m))
                depth_m = depths(placed[i].at((s, first[rows])), placed[j].at((s, second[rows])))
                keep = depth_m > -near_m - _ROUNDING_M
                yield s[keep], starts[i] + first[rows[keep]], starts[j] + second[rows[keep]], depth_m[keep]


def _bounds_meet(a: Zonotopes, b: Zonotopes, first: Index, second: Index, near_m: float) -> NDArray[np.bool_]:
    reach_a, reach_b = a.reach()[:, first], b.reach()[:, second]
    apart = np.abs(a.centres[:, first] - b.centres[:, second])
    return np.asarray((apart <= reach_a + reach_b + near_m + _ROUNDING_M).all(axis=2))


def _overlap(low: Float, high: Float, other_low: Float, other_high: Float) -> NDArray[np.bool_]:
    return np.asarray(((low <= other_high) & (high >= other_low)).all(axis=-1))


def _ground(structure: Structure) -> Iterator[Member]:
    if structure.ground_z_m is not None:
        x, y, _ = np.mean([member.T_world_member.translation for member in structure.members], axis=0).tolist()
        yield Member("ground", Box((_GROUND_M, _GROUND_M, 1.0)), SE3.trans(x, y, structure.ground_z_m - 0.5))


def _obstacles_of(members: tuple[Member, ...]) -> Iterator[_Obstacles]:
    kinds: dict[int, list[tuple[int, Zonotopes]]] = {}
    faces: list[tuple[int, Mesh]] = []
    for i, member in enumerate(members):
        if isinstance(member.solid, Mesh):
            faces.append((i, member.solid.moved(member.T_world_member)))
        else:
            solid = zonotope(member.solid).moved(member.T_world_member.matrix)
            kinds.setdefault(solid.generators.shape[-2], []).append((i, solid))
    for kind in kinds.values():
        rows, solids = zip(*kind, strict=True)
        stack = stacked(solids)
        reach = stack.reach()
        yield _Obstacles(stack.centres - reach, stack.centres + reach, np.array(rows), solids=stack)
    if faces:
        yield _faces(faces)


def _faces(meshes: list[tuple[int, Mesh]]) -> _Obstacles:
    corners = np.concatenate([mesh.vertices_m.astype(np.float64)[mesh.triangles] for _, mesh in meshes])
    member = np.repeat([i for i, _ in meshes], [len(mesh.triangles) for _, mesh in meshes])
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    is_face = area > 0
    corners, normals, member = corners[is_face], across[is_face] / area[is_face, None], member[is_face]
    return _Obstacles(corners.min(axis=1), corners.max(axis=1), member, corners=corners, normals=normals)
