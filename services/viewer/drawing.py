"""What the scene consists of: archetypes at entity paths, and models, before they go to any viewer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Drawing:
    """Rerun archetypes at one entity path, which hold from `stamp_ns` on."""

    entity: str
    archetypes: tuple[Any, ...]
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class Model:
    """A URDF document below an entity path; its links stand where the frames of their names are."""

    entity: str
    urdf: str


@dataclass(frozen=True, slots=True)
class Edges:
    """Edges of the frame tree, row by row, all at one entity path: T_parent_child (N, 7), metres and x y z w."""

    entity: str
    parents: tuple[str, ...]
    children: tuple[str, ...]
    T_parent_child: NDArray[np.float64]
    stamp_ns: int


Drawn = Drawing | Model | Edges
