"""What can be drawn of a URDF document: coloured triangles, link by link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.meshes import merged, mesh_of
from shared.robot.description import Shape
from shared.robot.urdf import parse_urdf
from shared.solids import Box
from shared.xml_reading import XmlError, root_of

Colour = tuple[int, int, int]

_NO_COLOUR: Colour = (150, 155, 160)


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Triangles (T, 3) of vertices (V, 3) in the frame of a link. is_flat: its edges are sharp."""

    link: str
    vertices_m: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    colour: Colour
    is_flat: bool


def bodies_of(urdf: str, source: str) -> list[Body]:
    """The visible shapes of a document, those of one link and material as one body.

    Raises:
        InputFileError: the document is malformed; `source` names it.
    """
    model, colours = parse_urdf(urdf, source), _colours(urdf)
    groups: dict[tuple[str, str, bool], list[Shape]] = {}
    for shape in model.shapes:
        groups.setdefault((shape.link, shape.material, isinstance(shape.solid, Box)), []).append(shape)
    return [
        _body(link, shapes, colours.get(material, _NO_COLOUR), is_flat)
        for (link, material, is_flat), shapes in groups.items()
    ]


def thinned(cloud: NDArray[np.float32], max_points: int) -> NDArray[np.float32]:
    """At most so many points (N, 3), evenly chosen."""
    stride = -(-len(cloud) // max_points) if len(cloud) else 1
    return cloud[::stride]


def height_shades(points_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """0..1 from the lowest to the highest of points (N, 3)."""
    z = points_m[:, 2]
    return np.asarray((z - z.min()) / max(float(np.ptp(z)), 1e-6), dtype=np.float32)


def _body(link: str, shapes: list[Shape], colour: Colour, is_flat: bool) -> Body:
    mesh = merged([mesh_of(shape.solid).moved(shape.T_link_shape) for shape in shapes])
    return Body(link, mesh.vertices_m.astype(np.float32), mesh.triangles, colour, is_flat)


def _colours(urdf: str) -> dict[str, Colour]:
    try:
        materials = root_of(urdf, "robot").findall("material")
    except XmlError:
        return {}
    found: dict[str, Colour] = {}
    for material in materials:
        colour = material.find("color")
        if colour is not None:
            red, green, blue = (round(255 * float(part)) for part in colour.get("rgba", "").split()[:3])
            found[material.get("name", "")] = (red, green, blue)
    return found
