import numpy as np
import pytest
from hypothesis import given, strategies as st

from shared.climbing.steel import SteelSurface
from shared.geometry import SE3
from shared.solids import Box, Cylinder
from shared.world.structure import Member, Structure

BEAM = Member("beam", Box((2.0, 0.2, 0.2)), SE3.trans(z_m=-0.1))
"""Its top is at z = 0."""
BESIDE = Member("beside", Box((2.0, 0.2, 0.2)), SE3.trans(y_m=0.2, z_m=-0.1))


def surface(*members: Member) -> SteelSurface:
    return SteelSurface(Structure("s", members, None))


def foot(x_m=0.0, y_m=0.0, gap_m=0.0, tilt_rad=0.0) -> SE3:
    """A foot whose sole's centre is `gap_m` above z = 0."""
    return SE3.trans(x_m, y_m, gap_m) @ SE3.rot("x", tilt_rad) @ SE3.trans(z_m=0.005)


@given(st.floats(-0.019, 0.019), st.floats(-0.9, 0.9), st.floats(-0.05, 0.05), st.floats(-np.pi, np.pi))
def test_a_level_sole_reads_its_gap_anywhere_on_the_beam(gap_m, x_m, y_m, yaw_rad):
    turned = foot(x_m, 0.3 * y_m, gap_m) @ SE3.rot("z", yaw_rad)
    contact = surface(BEAM).under_sole(turned)
    assert contact.gap_m == pytest.approx(gap_m, abs=1e-12)
    assert contact.angle_rad < 1e-7
    assert (contact.coverage, contact.members) == (1.0, ("beam",))


def test_a_tilted_sole_reads_its_farthest_corner():
    contact = surface(BEAM).under_sole(foot(tilt_rad=0.1))
    assert contact.angle_rad == pytest.approx(0.1, abs=1e-9)
    assert abs(contact.gap_m) == pytest.approx(0.0495 * np.tan(0.1), abs=1e-12)
    assert contact.is_flush(0.006, 0.11)
    assert not contact.is_flush(0.004, 0.11)
    assert not contact.is_flush(0.006, 0.09)


def test_a_sole_past_the_edge_is_not_covered():
    contact = surface(BEAM).under_sole(foot(y_m=0.1))
    assert contact.coverage == pytest.approx(0.6)
    assert not contact.is_flush(1.0, 1.0)
    assert surface(BEAM, BESIDE).under_sole(foot(y_m=0.1)).members == ("beam", "beside")
    assert surface(BEAM, BESIDE).under_sole(foot(y_m=0.1)).is_flush(1e-9, 1e-6)


@pytest.mark.parametrize("gap_m", [0.021, -0.021, 1.0])
def test_out_of_reach_there_is_nothing(gap_m):
    contact = surface(BEAM).under_sole(foot(gap_m=gap_m))
    assert (contact.coverage, contact.members) == (0.0, ())
    assert contact.gap_m == np.inf
    assert surface(BEAM).flush_pose(foot(gap_m=gap_m)) is None


def test_only_faces_towards_the_sole_count():
    upside_down = SE3.trans(z_m=0.0) @ SE3.rot("x", np.pi) @ SE3.trans(z_m=0.005)
    assert surface(BEAM).under_sole(upside_down).coverage == 0.0
    assert surface().under_sole(foot()).coverage == 0.0


def test_a_tube_is_no_flat_floor():
    tube = Member("tube", Cylinder(0.1, 2.0), SE3.trans(z_m=-0.1) @ SE3.rot("y", np.pi / 2))
    contact = surface(tube).under_sole(foot())
    assert contact.coverage == 1.0
    assert contact.gap_m > 0.01
    assert contact.angle_rad > np.deg2rad(20)


@given(st.floats(-0.01, 0.01), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_the_flush_pose_is_flush_and_near(gap_m, tilt_rad, x_m):
    T = foot(x_m, 0.0, gap_m, tilt_rad)
    flush = surface(BEAM).flush_pose(T)
    contact = surface(BEAM).under_sole(flush)
    assert contact.is_flush(1e-9, 1e-7)
    moved = T.inv() @ flush
    assert moved.angle_rad == pytest.approx(abs(tilt_rad), abs=1e-7)
    assert np.linalg.norm(moved.translation) < abs(gap_m) / np.cos(tilt_rad) + 0.005 * abs(tilt_rad) + 1e-9


@pytest.mark.parametrize(
    ("T", "distance_m"),
    [
        (foot(gap_m=0.25), 0.25),
        (foot(gap_m=-0.05), 0.05),  # to the face, also from inside
        (foot(0.0, 0.4, 0.4), 0.5),  # 0.3 beside and 0.4 above an edge
        (foot(1.3, 0.1, 0.4), 0.5),
        (foot(1.2, 0.3, 0.1), 0.3),  # to a corner
    ],
)
def test_the_distance_to_steel_any_way(T, distance_m):
    assert surface(BEAM).distance_m(T) == pytest.approx(distance_m, abs=1e-12)


def test_the_distance_is_to_the_nearest_of_many_and_infinite_without_any():
    rows = [Member(f"far_{i}", Box((0.2, 0.2, 0.2)), SE3.trans(x_m=3.0 + i)) for i in range(40)]
    assert surface(*rows, BEAM).distance_m(foot(gap_m=0.7)) == pytest.approx(0.7)
    assert surface().distance_m(foot()) == np.inf
