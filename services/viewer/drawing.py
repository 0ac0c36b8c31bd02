"""What the scene consists of: archetypes at entity paths, and models, before they go to any viewer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Drawing:
    """A Rerun archetype at an entity path, which holds from `stamp_ns` on. frame: of its coordinates, if it has any."""

    entity: str
    archetype: Any
    stamp_ns: int
    frame: str | None = None


@dataclass(frozen=True, slots=True)
class Model:
    """A URDF document below an entity path; its links stand where the frames of their names are."""

    entity: str
    urdf: str


@dataclass(frozen=True, slots=True)
class Edges:
    """Edges of the frame tree, row by row, all at one entity path.

    T_parent_child (N, 7): metres, quaternion x y z w. stamp_ns: from when on they hold; None = at all times.
    """

    entity: str
    parents: tuple[str, ...]
    children: tuple[str, ...]
    T_parent_child: NDArray[np.float64]
    stamp_ns: int | None


Drawn = Drawing | Model | Edges
