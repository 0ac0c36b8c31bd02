import dataclasses

import numpy as np
import pytest

from shared.climbing.collision import REACH_M, CollisionModel
from shared.climbing.stance import Stance
from shared.climbing.transit import line_samples
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.messaging.messages import Foot
from shared.robot.description import Shape
from shared.robot.kinematics import LINKS
from shared.solids import Box, Cylinder, Mesh
from shared.world.structure import Member, Structure
from tests.support.postures import MODEL, random_postures
from tests.support.steel import BEAM, ORIGINAL, structure

ON_BEAM = Stance(Foot.A, SE3.trans(z_m=0.005))
ZERO = np.zeros((1, 8))


def around(*members, stance=ON_BEAM):
    return CollisionModel(MODEL, structure(*members)).around(stance)


def block(name, x_m, y_m, z_m, size_m=(0.1, 0.1, 0.1)):
    return Member(name, Box(size_m), SE3.trans(x_m, y_m, z_m))


def test_standing_upright_on_a_beam_touches_and_cuts_nothing():
    contacts = around(BEAM).contacts(ZERO)
    assert contacts.depth_m == pytest.approx(0.0, abs=1e-12)
    assert (contacts.link, contacts.other) == (("foot_b",), ("beam",))
    assert around(BEAM).is_free(ZERO).all()
    assert not around(BEAM).is_free(ZERO, 0.003).any()


@pytest.mark.parametrize(
    ("member", "link", "depth_m"),
    [
        (block("top", 0.075, 0.0, 0.388), "lidar", 0.010),  # the housing reaches up to 0.27 + 0.0415 + 0.0365 = 0.348
        (block("side", -0.09, 0.0, 0.265), "hip", 0.010),  # the hip plate begins at x = -0.05
        (block("under", 0.2, 0.0, -0.045), "foot_b", 0.005),  # its sole is at z = 0
        (Member("tube", Cylinder(0.05, 1.0), SE3.trans(-0.09, z_m=0.265) @ SE3.rot("x", np.pi / 2)), "hip", 0.010),
        (Member("shell", mesh_of(Box((0.1, 0.1, 0.1))), SE3.trans(-0.09, z_m=0.265)), "hip", 0.010),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_the_deepest_link_and_its_depth_by_hand(member, link, depth_m):
    contacts = around(BEAM, member).contacts(ZERO)
    assert (contacts.link, contacts.other) == ((link,), (member.name,))
    assert contacts.depth_m[0] == pytest.approx(depth_m, abs=1e-4)


def test_the_fixed_foot_is_not_checked_against_members_whichever_it_is():
    low = Stance(Foot.A, SE3.trans(z_m=-0.015))
    assert around(BEAM, stance=low).contacts(ZERO).link == ("foot_b",)
    other = Stance(Foot.B, low.T_world_free(ZERO[0]))
    contacts = around(BEAM, stance=other).contacts(ZERO)
    assert contacts.link == ("foot_a",)
    assert contacts.depth_m == pytest.approx(0.02)


def test_a_robot_folded_onto_itself_names_both_links():
    folded = np.array([[0.0, -0.025, 1.5, np.pi, 0.0, 1.5, 0.0, 0.0]])
    contacts = around().contacts(folded)
    assert contacts.depth_m[0] > 0.005
    assert set(contacts.link + contacts.other) <= {*LINKS, "lidar"}
    assert not around().is_free(folded).any()


def test_the_ground_is_in_the_way_too():
    grounded = CollisionModel(MODEL, Structure("grounded", (BEAM,), ground_z_m=0.002))
    contacts = grounded.around(ON_BEAM).contacts(ZERO)
    assert (contacts.link, contacts.other) == (("foot_b",), ("ground",))
    assert contacts.depth_m == pytest.approx(0.002, abs=1e-9)


def test_linked_bodies_are_no_collision_and_nothing_near_is_minus_infinity():
    contacts = around().contacts(ZERO)
    assert contacts.depth_m == [-np.inf]
    assert (contacts.link, contacts.other) == (("",), ("",))


def test_near_is_told_as_a_negative_depth():
    near = block("near", 0.075, 0.0, 0.348 + 0.054)
    assert around(near).contacts(ZERO, 0.003).depth_m == [-np.inf]
    assert around(near).contacts(ZERO, 0.005).depth_m == pytest.approx(-0.004)


def test_many_postures_are_judged_as_each_alone_and_feet_change_nothing():
    q = random_postures(60)
    free = CollisionModel(MODEL, ORIGINAL)
    stance = Stance(Foot.A, SE3.from_rpy((0, 0, np.pi / 2), (0, -0.775, 10.105)))
    together = free.around(stance).contacts(q)
    assert (together.depth_m > 0).sum() > 10
    for row, depth_m in zip(q, together.depth_m, strict=True):
        assert free.around(stance).contacts(row[None]).depth_m == depth_m


def test_only_what_is_within_reach_is_looked_at():
    far = block("far", 0.0, 0.0, REACH_M + 0.06)
    assert sum(len(kind.low) for kind in around(far, BEAM)._obstacles) == 1


def test_no_point_of_the_robot_is_beyond_its_reach():
    surroundings = around()
    T = ON_BEAM.T_world_links(random_postures(2000))
    for kind in surroundings._bodies:
        points = kind.corners_m() @ T[:, kind.chain][..., :3, :3].swapaxes(-1, -2) + T[:, kind.chain][..., None, :3, 3]
        assert np.abs(points).max() < REACH_M


@pytest.mark.parametrize("foot", Foot)
def test_no_point_moves_farther_than_a_step_between_samples(foot):
    start, end = random_postures(2, seed=3)
    stance = Stance(foot, SE3.identity())
    bodies = CollisionModel(MODEL, structure(BEAM)).bodies
    samples = line_samples(start, end, stance, bodies, 0.003)
    assert (samples[0] == start).all()
    assert samples[-1] == pytest.approx(end)
    T = stance.T_world_links(samples)
    for kind in bodies:
        points = kind.corners_m() @ T[:, kind.chain][..., :3, :3].swapaxes(-1, -2) + T[:, kind.chain][..., None, :3, 3]
        assert np.linalg.norm(np.diff(points, axis=0), axis=-1).max() <= 0.003


def test_a_collision_shape_that_cannot_be_used_is_named():
    shape = Shape("hip", Mesh(np.eye(3), np.array([[0, 1, 2]], dtype=np.uint32)), SE3.identity())
    with pytest.raises(InputFileError, match="collision of link 'hip': must be a box, cylinder or sphere"):
        CollisionModel(dataclasses.replace(MODEL, collisions=(shape,)), structure(BEAM))
