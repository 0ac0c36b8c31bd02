import numpy as np
import pytest

from services.evaluator.map_accuracy import (
    distances_to_box,
    distances_to_shapes,
    map_accuracy,
    num_points_off_planes,
)
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.robot.description import Shape, UrdfModel
from shared.solids import Box, Cylinder, Sphere

BOX = Box((2.0, 4.0, 6.0))


def structure(*shapes):
    return UrdfModel(name="s", root="structure", links=("structure",), joints=(), shapes=shapes)


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ((1.0, 0.0, 0.0), 0.0),
        ((1.5, 0.0, 0.0), 0.5),
        ((0.9, 0.0, 0.0), 0.1),
        ((0.0, 0.0, 0.0), 1.0),
        ((4.0, 6.0, 0.0), 5.0),
        ((-1.0, -2.0, -3.5), 0.5),
    ],
)
def test_distance_to_a_box_by_hand(point, distance):
    assert distances_to_box(np.array([point]), BOX, SE3.identity())[0] == pytest.approx(distance)


def test_distance_to_a_turned_box():
    T = SE3.trans(10.0) @ SE3.rot("z", np.pi / 2)  # its y axis, half of 4 m, lies along x
    assert distances_to_box(np.array([[7.5, 0.0, 0.0]]), BOX, T)[0] == pytest.approx(0.5)


def test_the_nearest_of_two_boxes_counts():
    two = structure(Shape("structure", BOX, SE3.identity()), Shape("structure", BOX, SE3.trans(10.0)))
    accuracy = map_accuracy(np.array([[1.1, 0.0, 0.0], [8.7, 0.0, 0.0]]), two)
    assert accuracy.num_points == 2
    assert accuracy.mean_m == pytest.approx(0.2)
    assert accuracy.max_m == pytest.approx(0.3)
    assert accuracy.rmse_m == pytest.approx(np.sqrt((0.1**2 + 0.3**2) / 2))


def test_each_of_many_boxes_is_compared_with_where_it_may_be_the_nearest():
    rng = np.random.default_rng(5)
    points = rng.uniform(-10, 10, (200, 3))
    shapes = [
        Shape("s", Box(tuple(rng.uniform(0.1, 5, 3))), SE3.from_rpy(rng.uniform(-3, 3, 3), rng.uniform(-10, 10, 3)))
        for _ in range(30)
    ]
    expected = np.min([distances_to_box(points, shape.solid, shape.T_link_shape) for shape in shapes], axis=0)
    np.testing.assert_array_equal(distances_to_shapes(points, shapes), expected)


def test_a_cylinder_and_a_mesh_are_compared_with_far_from_the_origin():
    T = SE3.trans(1e5) @ SE3.rot("y", np.pi / 2)
    tube = Shape("s", Cylinder(0.5, 4.0), T)
    part = Shape("s", mesh_of(BOX), T @ SE3.trans(y_m=10.0))
    points = T.apply(np.array([[0.0, 0.0, 2.3], [0.7, 0.0, 0.0], [0.0, 0.0, 1.9], [1.2, 10.0, 0.0], [0.9, 10.0, 0.0]]))
    np.testing.assert_allclose(distances_to_shapes(points, [tube, part]), [0.3, 0.2, 0.1, 0.2, 0.1], atol=1e-5)


def test_shapes_on_other_links_are_refused():
    with pytest.raises(ValueError, match="arm: only shapes on the root link"):
        map_accuracy(
            np.zeros((1, 3)), structure(Shape("structure", BOX, SE3.identity()), Shape("arm", BOX, SE3.trans()))
        )


def test_a_ball_counts_too():
    ball = Shape("s", Sphere(1.0), SE3.identity())
    np.testing.assert_allclose(distances_to_shapes(np.array([[0.0, 0.0, 1.5]]), [ball]), [0.5], atol=1e-6)


def test_an_empty_map_has_no_accuracy():
    with pytest.raises(ValueError, match="no points"):
        map_accuracy(np.empty((0, 3)), structure(Shape("structure", BOX, SE3.identity())))


def test_points_off_planes_are_those_that_no_plane_holds():
    rng = np.random.default_rng(3)
    floor, ceiling = rng.uniform(0, 1, (2, 300, 3))
    floor[:, 2], ceiling[:, 2] = 0.0, 3.0
    stray = np.array([[0.5, 0.5, 2.0], [1.5, 0.2, 5.0], [2.0, 0.9, 1.0]])
    points = np.vstack([floor, ceiling, stray])
    assert num_points_off_planes(points, num_planes=2, distance_m=0.04, seed=1) == len(stray)
    assert num_points_off_planes(points, num_planes=1, distance_m=0.04, seed=1) == 300 + len(stray)
    assert num_points_off_planes(points, num_planes=9, distance_m=0.04, seed=1) == 0
