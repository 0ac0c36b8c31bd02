import itertools
from collections import Counter
from functools import partial

import numpy as np
import pytest

from shared.geometry import SE3
from shared.world.generator import BRACINGS, Lattice, crossed_truss, orthogonal_truss, tower
from shared.world.mesh_format import world_mesh
from shared.world.structure import problems_of

LATTICE = Lattice(spacing_m=2.0, width_m=0.15, bays=(2, 2, 3))
KINDS = [orthogonal_truss, crossed_truss, tower, partial(tower, bracing="k")]


def kinds_of_bars(structure):
    return Counter("_".join(member.name.split("_")[:2]).rstrip("_0123456789") for member in structure.members)


def by_name(structure):
    return {member.name: member for member in structure.members}


def test_an_orthogonal_truss_has_a_bar_between_any_two_neighbours():
    structure = orthogonal_truss(LATTICE)
    assert kinds_of_bars(structure) == {"post": 9 * 3, "beam_x": 2 * 3 * 4, "beam_y": 2 * 3 * 4}
    bars = by_name(structure)
    post, beam = bars["post_0_1_1"], bars["beam_y_2_0_3"]
    np.testing.assert_allclose(post.T_world_member.translation, [-2, 0, 3.075])
    assert post.solid.size_m == pytest.approx((0.15, 0.15, 2.0))
    np.testing.assert_allclose(beam.T_world_member.translation, [2, -1, 6.075])
    assert beam.solid.size_m == pytest.approx((0.15, 1.85, 0.15))
    assert all(np.array_equal(bar.T_world_member.rotation, np.eye(3)) for bar in structure.members)
    assert structure.ground_z_m == 0.0


def test_its_bars_touch_but_nowhere_overlap():
    members = orthogonal_truss(LATTICE).members
    half = np.array([bar.solid.size_m for bar in members]) / 2
    centre = np.array([bar.T_world_member.translation for bar in members])
    for i, j in itertools.combinations(range(len(members)), 2):
        overlap = (half[i] + half[j]) - np.abs(centre[i] - centre[j])
        assert overlap.min() < 1e-9, (members[i].name, members[j].name)


def test_a_crossed_truss_has_two_diagonals_in_each_outer_face_beside_each_other():
    structure = crossed_truss(LATTICE)
    assert kinds_of_bars(structure) == kinds_of_bars(orthogonal_truss(LATTICE)) + Counter(
        {"diagonal_x": 2 * 2 * 2 * 3, "diagonal_y": 2 * 2 * 2 * 3}
    )
    bars = by_name(structure)
    rising, falling = (bars[f"diagonal_x_0_0_0_{way}"] for way in ("rising", "falling"))
    for bar, slope in ((rising, 1), (falling, -1)):
        x_axis = bar.T_world_member.rotation[:, 0]
        np.testing.assert_allclose(x_axis, np.array([1, 0, slope]) / np.sqrt(2), atol=1e-12)
        assert bar.solid.size_m == pytest.approx((np.sqrt(8), 0.06, 0.15))
    y = [bar.T_world_member.translation[1] + 2.0 for bar in (rising, falling)]
    assert sorted(y) == pytest.approx([-0.0375, 0.0375])  # each 0.06 thick: 0.015 between them, within the beams' 0.15


@pytest.mark.parametrize("bracing", BRACINGS)
def test_a_tower_has_legs_rings_and_bracing(bracing):
    lattice = Lattice(spacing_m=1.5, width_m=0.1, bays=(2, 2, 6), base_z_m=3.0)
    structure = tower(lattice, taper=0.5, bracing=bracing)
    assert kinds_of_bars(structure) == {
        "post": 4 * 6,
        "beam_x": 2 * 6,
        "beam_y": 2 * 6,
        "diagonal_x": 2 * 2 * 6,
        "diagonal_y": 2 * 2 * 6,
    }
    vertices = world_mesh(structure).vertices_m
    low, high = vertices[vertices[:, 2] < 3.1], vertices[vertices[:, 2] > 11.9]
    assert np.ptp(low[:, 0]) == pytest.approx(3.1, abs=0.02)
    assert np.ptp(high[:, 1]) == pytest.approx(1.6, abs=0.02)
    assert (vertices[:, 2].min(), vertices[:, 2].max()) == pytest.approx((3.0, 12.1), abs=0.01)


def test_a_tower_may_be_straight():
    structure = tower(Lattice(bays=(1, 1, 2)), taper=1.0)
    posts = [bar for bar in structure.members if bar.name.startswith("post")]
    assert all(np.array_equal(bar.T_world_member.rotation, np.eye(3)) for bar in posts)


@pytest.mark.parametrize("make", KINDS)
def test_all_of_it_stands_on_its_base_and_turns_as_one(make):
    plain = make(LATTICE)
    placed = make(Lattice(bays=(2, 2, 3), yaw_deg=17.3, base_z_m=8.0))
    T = SE3.trans(z_m=8.0) @ SE3.rot("z", np.deg2rad(17.3))
    for before, after in zip(plain.members, placed.members, strict=True):
        assert (before.name, before.solid) == (after.name, after.solid)
        np.testing.assert_allclose(after.T_world_member.matrix, (T @ before.T_world_member).matrix, atol=1e-12)
    assert world_mesh(plain).vertices_m[:, 2].min() == pytest.approx(0.0, abs=0.03)  # legs of a tower lean


@pytest.mark.parametrize("make", KINDS)
def test_imperfection_is_drawn_by_the_seed(make):
    def centres(seed, imperfection_m):
        structure = make(Lattice(bays=(2, 2, 3), seed=seed, imperfection_m=imperfection_m))
        assert problems_of(structure) == []
        return np.array([bar.T_world_member.translation for bar in structure.members])

    np.testing.assert_array_equal(centres(1, 0.0), centres(2, 0.0))
    np.testing.assert_array_equal(centres(1, 0.01), centres(1, 0.01))
    assert np.abs(centres(1, 0.01) - centres(2, 0.01)).max() > 0.005


def test_imperfection_is_that_of_the_nodes():
    lattice = Lattice(bays=(9, 9, 9), seed=3, imperfection_m=0.01)
    perfect, built = by_name(orthogonal_truss(Lattice(bays=(9, 9, 9)))), by_name(orthogonal_truss(lattice))
    posts = [name for name in built if name.startswith("post")]
    moved = np.array(
        [built[name].T_world_member.translation - perfect[name].T_world_member.translation for name in posts]
    )
    np.testing.assert_allclose(moved.std(axis=0), 0.01 / np.sqrt(2), rtol=0.1)  # a post's middle lies between two nodes


@pytest.mark.parametrize("make", KINDS)
def test_no_two_bars_have_the_same_name(make):
    assert problems_of(make(LATTICE)) == []


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"spacing_m": 0.2}, r"width 0\.15 m must be above 0 and at most half the spacing"),
        ({"width_m": 0.0}, "width 0 m must be above 0"),
        ({"spacing_m": 101.0}, "at most 100 m"),
        ({"spacing_m": float("nan")}, "every length and angle must be finite"),
        ({"yaw_deg": float("inf")}, "every length and angle must be finite"),
        ({"bays": (0, 1, 1)}, "bays must be at least 1"),
        ({"bays": (1000, 1000, 1000)}, "make at most 100000 bars"),
        ({"imperfection_m": -0.1}, "imperfection must be between 0 and the width"),
        ({"imperfection_m": 0.2}, "imperfection must be between 0 and the width"),
        ({"seed": -1}, "seed must not be negative"),
    ],
)
def test_what_cannot_be_built_is_refused(change, reason):
    with pytest.raises(ValueError, match=reason):
        Lattice(**change)


def test_towers_that_cannot_be_built_are_refused():
    with pytest.raises(ValueError, match=r"taper must be between 0\.1 and 1, got 2"):
        tower(LATTICE, taper=2.0)
    with pytest.raises(ValueError, match="bracing must be one of x, k, got 'y'"):
        tower(LATTICE, bracing="y")
    with pytest.raises(ValueError, match=r"the top would be 0\.2 m wide, less than two bars"):
        tower(LATTICE, taper=0.1)
