import numpy as np
import pytest

from services.mapper.body import BodyFilter
from shared.geometry import SE3
from shared.robot.description import Shape
from shared.solids import Box, Cylinder, Mesh, Sphere

SHAPES = (
    Shape("arm", Box((0.4, 0.2, 0.2)), SE3.trans(x_m=0.2)),
    Shape("hand", Cylinder(0.1, 0.6), SE3.rot("y", np.pi / 2)),
    Shape("arm", Sphere(0.15), SE3.trans(z_m=1.0)),
)


def poses(*transforms):
    return np.array([T.matrix for T in transforms])


def test_points_in_the_boxes_or_on_their_margin_are_on_the_body():
    body = BodyFilter(SHAPES, margin_m=0.02)
    assert body.links == ("arm", "hand")
    at = poses(SE3.trans(y_m=1.0) @ SE3.rot("z", np.pi / 2), SE3.trans(x_m=-2.0))
    on = [[0.0, 1.2, 0.0], [0.11, 1.0, 0.0], [0.0, 1.41, 0.0], [0.0, 1.0, 1.16], [-2.31, 0.0, 0.11]]
    off = [[0.13, 1.0, 0.0], [0.0, 1.43, 0.0], [0.0, 1.0, 1.18], [-2.33, 0.0, 0.0], [-2.0, 0.0, 0.13], [9.0, 9.0, 9.0]]
    off += [[np.nan, 1.2, 0.0], [np.inf, 0.0, 0.0]]
    for dtype in (np.float32, np.float64):
        is_body = body.on_body(np.array(on + off, dtype=dtype), at)
        assert is_body.tolist() == [True] * len(on) + [False] * len(off)


def test_a_mesh_is_the_box_around_it():
    mesh = Mesh(np.array([[0.0, 0, 0], [1.0, 0, 0], [0, 2.0, 0], [0, 0, 3.0]]), np.zeros((1, 3), dtype=np.uint32))
    body = BodyFilter([Shape("foot", mesh, SE3.identity())], margin_m=0.0)
    points = np.array([[0.9, 1.9, 2.9], [-0.1, 0.5, 0.5], [0.5, 0.5, 3.1]])
    assert body.on_body(points, poses(SE3.identity())).tolist() == [True, False, False]


def test_a_robot_without_shapes_has_no_body():
    assert not BodyFilter([]).on_body(np.zeros((3, 3)), np.empty((0, 4, 4))).any()


def test_every_link_needs_its_pose():
    with pytest.raises(ValueError, match=r"poses \(2, 4, 4\), got \(1, 4, 4\)"):
        BodyFilter(SHAPES).on_body(np.zeros((1, 3)), poses(SE3.identity()))
