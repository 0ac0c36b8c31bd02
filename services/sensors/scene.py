"""What rays can meet: the visible shapes as convex faces, each fixed to a link, and what each face is called."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.meshes import polygons_of
from shared.robot.description import Shape

Ints = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Convex faces (F), wound counter-clockwise seen from outside, those of one shape side by side.

    vertices_m (V, 3): of all faces, each in its link's frame; face k has those from starts[k] to starts[k + 1].
    starts (F + 1,). shape (F,): number of the shape the face belongs to. face (F,): which one of it, see
    `shared.meshes.faces_of`. shape_link (M,): number of the link each shape is fixed to, in `links`. is_convex (M,):
    whether the faces of a shape bound one convex body. materials: of the shapes. members (M,): the number by which the
    ground truth calls each.
    """

    links: tuple[str, ...]
    vertices_m: NDArray[np.float64]
    starts: NDArray[np.int64]
    shape: Ints
    face: Ints
    shape_link: Ints
    is_convex: NDArray[np.bool_]
    materials: tuple[str, ...]
    names: tuple[str, ...]
    members: Ints

    @property
    def member_of_face(self) -> Ints:
        """(F,): what the ground truth calls the shape of each face."""
        return self.members[self.shape]

    @property
    def num_faces(self) -> int:
        """F."""
        return len(self.shape)


def scene_of(shapes: Sequence[Shape], members: Sequence[int] | None = None) -> Scene:
    """The scene of these shapes, numbered in their order. A shape without a name of its own goes by its link's.

    members: what the ground truth calls the shapes; by default by their numbers.
    """
    parts = [polygons_of(shape.solid) for shape in shapes]
    vertices_m = [shape.T_link_shape.apply(part.vertices_m) for shape, part in zip(shapes, parts, strict=True)]
    links = tuple(dict.fromkeys(shape.link for shape in shapes))
    sizes = np.concatenate([part.sizes for part in parts]) if parts else np.empty(0, dtype=np.int64)
    num_faces = [len(part.sizes) for part in parts]
    return Scene(
        links=links,
        vertices_m=np.concatenate([*vertices_m, np.empty((0, 3))]).astype(np.float64),
        starts=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        shape=np.repeat(np.arange(len(shapes)), num_faces).astype(np.int32),
        face=np.concatenate([np.empty(0, dtype=np.int32), *(part.faces for part in parts)]),
        shape_link=np.array([links.index(shape.link) for shape in shapes], dtype=np.int32),
        is_convex=np.array([part.is_convex for part in parts], dtype=np.bool_),
        materials=tuple(shape.material for shape in shapes),
        names=tuple(shape.name or shape.link for shape in shapes),
        members=np.array(range(len(shapes)) if members is None else members, dtype=np.int32),
    )
