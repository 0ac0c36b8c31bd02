"""Makes lattices: orthogonal and crossed trusses, towers. Pure: parameters in, structures out.

Posts run through the nodes and beams end at the posts' faces; diagonals lie in two layers inside the thickness of the
beams. So no two faces of different bars lie in the same plane one over the other.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared.geometry import SE3
from shared.solids import Box
from shared.world.structure import Member, Structure

Node = tuple[int, int, int]
Nodes = Mapping[Node, NDArray[np.float64]]
Bars = Iterator[tuple[str, Box, SE3]]

_LAYER_THICKNESS, _LAYER_OFFSET = 0.4, 0.25
"""Of a diagonal, in widths of a bar: a layer reaches from 0.05 to 0.45 of the width, on one side of the middle."""
_MAX_BARS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Lattice:
    """What all kinds have in common; the lattice stands on `base_z_m`, its first node near the world's z axis.

    spacing_m: from node to node. width_m: of the square bars. bays: along x, y, z. yaw_deg: the whole lattice is
    turned by so much about z. imperfection_m: standard deviation of each node's place along each axis, as built;
    `seed` draws it. ground_z_m: None for no ground.

    Raises:
        ValueError: a number is out of range, or bars would be shorter than they are wide.
    """

    spacing_m: float = 2.0
    width_m: float = 0.15
    bays: tuple[int, int, int] = (2, 2, 3)
    yaw_deg: float = 0.0
    base_z_m: float = 0.0
    imperfection_m: float = 0.0
    seed: int = 0
    ground_z_m: float | None = 0.0

    def __post_init__(self) -> None:
        numbers = [self.spacing_m, self.width_m, self.yaw_deg, self.base_z_m, self.imperfection_m]
        if not np.isfinite(numbers).all():
            raise ValueError("every length and angle must be finite")
        if min(self.bays) < 1 or np.prod([bays + 1.0 for bays in self.bays]) * 8 > _MAX_BARS:
            raise ValueError(f"bays must be at least 1 and make at most {_MAX_BARS} bars, got {self.bays}")
        if not 0 < 2 * self.width_m <= self.spacing_m <= 100:
            raise ValueError(
                f"width {self.width_m:g} m must be above 0 and at most half the spacing, spacing "
                f"{self.spacing_m:g} m at most 100 m"
            )
        if not 0 <= self.imperfection_m <= self.width_m:
            raise ValueError(f"imperfection must be between 0 and the width, got {self.imperfection_m:g} m")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")


def orthogonal_truss(lattice: Lattice) -> Structure:
    """Posts and beams between all nodes, all along the lattice's axes."""
    nodes = _nodes(lattice)
    return _structure("orthogonal", lattice, itertools.chain(_posts(nodes, lattice), _beams(nodes, lattice)))


def crossed_truss(lattice: Lattice) -> Structure:
    """An orthogonal truss with two crossing diagonals in each outer upright face of each bay."""
    nodes = _nodes(lattice)
    bars = itertools.chain(_posts(nodes, lattice), _beams(nodes, lattice), _face_bracing(nodes, lattice, _crossed))
    return _structure("crossed", lattice, bars)


def tower(lattice: Lattice, *, taper: float = 0.5, bracing: str = "x") -> Structure:
    """Four legs, rings of beams above the first level, and bracing in each face of each panel.

    The tower is as many spacings wide as it has bays along x and y, and as many panels high as along z.
    taper: width at the top in parts of that at the foot. bracing: a key of `BRACINGS`.

    Raises:
        ValueError: the taper is not within 0.1 and 1, or the bracing is unknown.
    """
    if not 0.1 <= taper <= 1:
        raise ValueError(f"taper must be between 0.1 and 1, got {taper:g}")
    if bracing not in BRACINGS:
        raise ValueError(f"bracing must be one of {', '.join(BRACINGS)}, got '{bracing}'")
    if taper * lattice.spacing_m < 2 * lattice.width_m:
        raise ValueError(f"the top would be {taper * lattice.spacing_m:g} m wide, less than two bars")
    num_x, num_y, num_panels = lattice.bays
    side_m = np.array([num_x, num_y, 1.0]) * lattice.spacing_m
    four_legs = replace(lattice, bays=(1, 1, num_panels))

    def place(node: Node) -> NDArray[np.float64]:
        narrowing = 1 - (1 - taper) * node[2] / num_panels
        return np.array([(node[0] - 0.5) * narrowing, (node[1] - 0.5) * narrowing, node[2]]) * side_m

    nodes = _nodes(four_legs, place)
    rings = (bar for bar in _beams(nodes, four_legs) if not bar[0].endswith("_0"))
    bars = itertools.chain(_posts(nodes, four_legs), rings, _face_bracing(nodes, four_legs, BRACINGS[bracing]))
    return _structure("tower", lattice, bars)


def _structure(name: str, lattice: Lattice, bars: Bars) -> Structure:
    T_world_lattice = SE3.trans(z_m=lattice.base_z_m) @ SE3.rot("z", float(np.deg2rad(lattice.yaw_deg)))
    members = tuple(Member(name, box, T_world_lattice @ T) for name, box, T in bars)
    return Structure(name, members, lattice.ground_z_m)


def _nodes(lattice: Lattice, place: Callable[[Node], NDArray[np.float64]] | None = None) -> Nodes:
    """Where each node is in the lattice's frame; the lowest are half a width up, so that posts stand on its floor."""
    rng = np.random.default_rng(lattice.seed)
    floor_m = np.array([0.0, 0.0, lattice.width_m / 2])
    middle = np.array([lattice.bays[0] / 2, lattice.bays[1] / 2, 0.0])
    nodes: dict[Node, NDArray[np.float64]] = {}
    for i, j, k in itertools.product(*(range(bays + 1) for bays in lattice.bays)):
        true_m = place((i, j, k)) if place else (np.array([i, j, k]) - middle) * lattice.spacing_m
        nodes[i, j, k] = true_m + floor_m + lattice.imperfection_m * rng.standard_normal(3)
    return nodes


def _posts(nodes: Nodes, lattice: Lattice) -> Bars:
    """One bar a bay of height; the lowest and the highest reach half a width beyond their node."""
    half_m, top = lattice.width_m / 2, lattice.bays[2]
    for i, j, k in nodes:
        if k < top:
            reach_m = (half_m if k == 0 else 0.0, half_m if k + 1 == top else 0.0)
            yield _bar(f"post_{i}_{j}_{k}", nodes[i, j, k], nodes[i, j, k + 1], 2, lattice.width_m, reach_m)


def _beams(nodes: Nodes, lattice: Lattice) -> Bars:
    """From each node to the next along x and along y, between the faces of their posts."""
    half_m = lattice.width_m / 2
    for axis, letter in enumerate("xy"):
        for i, j, k in nodes:
            end = (i + 1, j, k) if axis == 0 else (i, j + 1, k)
            if end in nodes:
                name = f"beam_{letter}_{i}_{j}_{k}"
                yield _bar(name, nodes[i, j, k], nodes[end], axis, lattice.width_m, (-half_m, -half_m))


def _face_bracing(nodes: Nodes, lattice: Lattice, pattern: Callable[..., Bars]) -> Bars:
    """The pattern in each upright face of each bay that is on the outside."""
    num_x, num_y, num_z = lattice.bays
    for k in range(num_z):
        for i, j in itertools.product(range(num_x), (0, num_y)):
            face = [nodes[i, j, k], nodes[i + 1, j, k], nodes[i, j, k + 1], nodes[i + 1, j, k + 1]]
            yield from pattern(f"x_{i}_{j}_{k}", face, lattice.width_m)
        for i, j in itertools.product((0, num_x), range(num_y)):
            face = [nodes[i, j, k], nodes[i, j + 1, k], nodes[i, j, k + 1], nodes[i, j + 1, k + 1]]
            yield from pattern(f"y_{i}_{j}_{k}", face, lattice.width_m)


def _crossed(name: str, face: list[NDArray[np.float64]], width_m: float) -> Bars:
    """Two diagonals side by side from corner to corner; corners: low left, low right, high left, high right."""
    low_left, low_right, high_left, high_right = face
    normal = np.cross(high_right - low_left, high_left - low_right)
    yield _diagonal(f"diagonal_{name}_rising", low_left, high_right, normal, width_m)
    yield _diagonal(f"diagonal_{name}_falling", high_left, low_right, -normal, width_m)


def _k_shaped(name: str, face: list[NDArray[np.float64]], width_m: float) -> Bars:
    """Two diagonals from the low corners to the middle of the upper beam."""
    low_left, low_right, high_left, high_right = face
    apex = (high_left + high_right) / 2
    normal = np.cross(low_right - low_left, high_left - low_left)
    yield _diagonal(f"diagonal_{name}_left", low_left, apex, normal, width_m)
    yield _diagonal(f"diagonal_{name}_right", low_right, apex, -normal, width_m)


BRACINGS: Mapping[str, Callable[..., Bars]] = {"x": _crossed, "k": _k_shaped}


def _bar(
    name: str,
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    axis: int,
    width_m: float,
    reach_m: tuple[float, float],
) -> tuple[str, Box, SE3]:
    """A square bar along its own `axis`, turned the least from the lattice's axes; it reaches beyond both nodes."""
    span = end - start
    length = float(np.linalg.norm(span))
    along = span / length
    middle = (start + end) / 2 + along * (reach_m[1] - reach_m[0]) / 2
    size = [width_m] * 3
    size[axis] = length + sum(reach_m)
    return name, Box((size[0], size[1], size[2])), SE3(_least_rotation(np.eye(3)[axis], along), middle)


def _diagonal(
    name: str, start: NDArray[np.float64], end: NDArray[np.float64], normal: NDArray[np.float64], width_m: float
) -> tuple[str, Box, SE3]:
    """A flat bar along its own x axis, its y axis nearest to `normal`, in the layer on that side of the nodes."""
    length = float(np.linalg.norm(end - start))
    x = (end - start) / length
    y = normal - (normal @ x) * x
    y /= np.linalg.norm(y)
    R = np.column_stack([x, y, np.cross(x, y)])
    centre = (start + end) / 2 + _LAYER_OFFSET * width_m * y
    return name, Box((length, _LAYER_THICKNESS * width_m, width_m)), SE3(R, centre)


def _least_rotation(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation (3, 3) by the least angle that turns unit vector a into b, which is not its opposite (Rodrigues)."""
    v = np.cross(a, b)
    V = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    R: NDArray[np.float64] = np.eye(3) + V + V @ V / (1 + float(a @ b))
    return R
