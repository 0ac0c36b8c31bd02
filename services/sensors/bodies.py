"""What the rays can meet: the visible shapes of each link as one mesh, and the names of what they meet."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from shared.meshes import faces_of, merged, mesh_of
from shared.robot.description import Shape
from shared.solids import Mesh


def link_meshes(shapes: Iterable[Shape]) -> dict[str, Mesh]:
    """One mesh a link that has shapes, in the link's frame."""
    parts: dict[str, list[Mesh]] = defaultdict(list)
    for shape in shapes:
        parts[shape.link].append(mesh_of(shape.solid).moved(shape.T_link_shape))
    return {link: merged(meshes) for link, meshes in parts.items()}


class Labels:
    """Tells of each triangle of `link_meshes` which shape and which face it is. names: of the shapes, by number.

    A shape without a name of its own goes by its link's.
    """

    def __init__(self, shapes: Sequence[Shape]) -> None:
        self.names = tuple(dict.fromkeys(shape.name or shape.link for shape in shapes))
        parts: dict[str, list[NDArray[np.int32]]] = defaultdict(list)
        for shape in shapes:
            faces = faces_of(shape.solid)
            number = self.names.index(shape.name or shape.link)
            parts[shape.link].append(np.column_stack([np.full_like(faces, number), faces]))
        self._of_link = {link: np.concatenate(tables) for link, tables in parts.items()}

    def of(self, links: Sequence[str], body: NDArray[np.int32], triangle: NDArray[np.int32]) -> NDArray[np.int32]:
        """Number of the shape and of its face (N, 2) for hits (N,) on bodies that are these links, in this order."""
        tables = [self._of_link[link] for link in links]
        starts = np.cumsum([0] + [len(table) for table in tables[:-1]])
        found: NDArray[np.int32] = np.concatenate(tables)[starts[body] + triangle]
        return found
