"""What the scene consists of: archetypes at entity paths, and models, before they go to any viewer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Drawing:
    """Rerun archetypes at one entity path. stamp_ns: from when on they hold; None = at all times."""

    entity: str
    archetypes: tuple[Any, ...]
    stamp_ns: int | None


@dataclass(frozen=True, slots=True)
class Model:
    """A URDF document below an entity path; its links stand where the frames of their names are."""

    entity: str
    urdf: str


Drawn = Drawing | Model
