"""What the rays can meet: the visible shapes of each link as one mesh."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from shared.meshes import merged, mesh_of
from shared.robot.description import Shape
from shared.solids import Mesh


def link_meshes(shapes: Iterable[Shape]) -> dict[str, Mesh]:
    """One mesh a link that has shapes, in the link's frame."""
    parts: dict[str, list[Mesh]] = defaultdict(list)
    for shape in shapes:
        parts[shape.link].append(mesh_of(shape.solid).moved(shape.T_link_shape))
    return {link: merged(meshes) for link, meshes in parts.items()}
