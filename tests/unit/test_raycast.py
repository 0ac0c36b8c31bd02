import numpy as np
import pytest

from services.sensors.raycast import NO_BODY, EmbreeRaycaster
from services.sensors.scan_pattern import scan_directions
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.runtime.config import LidarConfig
from shared.solids import Box, Sphere

FORWARD = np.array([[[1, 0, 0], [0, 1, 0]]], dtype=np.float32)


def cast(directions, *bodies, min_range_m=0.2):
    raycaster = EmbreeRaycaster(directions, min_range_m)
    raycaster.set_bodies([mesh_of(geometry) for geometry, _ in bodies])
    return raycaster.cast(SE3.identity(), [pose for _, pose in bodies])


def test_a_wall_is_met_at_its_distance_and_angle():
    angle = np.deg2rad(30)
    direction = np.array([[[np.cos(angle), np.sin(angle), 0]]], dtype=np.float32)
    hits = cast(direction, (Box((1, 100, 100)), SE3.trans(x_m=3.5)))
    assert hits.range_m[0, 0] == pytest.approx(3.0 / np.cos(angle), abs=1e-5)
    assert hits.cos_incidence[0, 0] == pytest.approx(np.cos(angle), abs=1e-6)


def test_the_whole_pattern_meets_the_room_around_it():
    directions = scan_directions(LidarConfig(num_columns=32, num_rings=16))
    hits = cast(directions, (Box((10, 10, 10)), SE3.identity()))
    expected = 5.0 / np.abs(directions).max(axis=-1)
    np.testing.assert_allclose(hits.range_m, expected, atol=1e-4)


def test_the_first_body_in_the_way_is_the_one_that_is_met():
    near, far = (Box((1, 1, 1)), SE3.trans(x_m=2.5)), (Sphere(1.0), SE3.trans(x_m=6.0))
    hits = cast(FORWARD, far, near)
    assert hits.range_m[0, 0] == pytest.approx(2.0, abs=1e-5)
    assert hits.body.tolist() == [[1, NO_BODY]]
    assert np.isinf(hits.range_m[0, 1])
    assert hits.cos_incidence[0, 1] == 0


def test_rays_start_at_the_minimum_range():
    housing, wall = (Sphere(0.1), SE3.identity()), (Box((1, 1, 1)), SE3.trans(x_m=2.5))
    assert cast(FORWARD, housing, wall).range_m[0, 0] == pytest.approx(2.0, abs=1e-5)
    assert cast(FORWARD, housing, wall, min_range_m=0.0).range_m[0, 0] == pytest.approx(0.1, abs=1e-3)


def test_bodies_move_from_cast_to_cast():
    raycaster = EmbreeRaycaster(FORWARD, 0.2)
    raycaster.set_bodies([mesh_of(Box((1, 1, 1)))])
    ranges = [raycaster.cast(SE3.identity(), [SE3.trans(x_m=x)]).range_m[0, 0] for x in (2.5, 4.5)]
    np.testing.assert_allclose(ranges, [2.0, 4.0], atol=1e-5)


def test_the_sensor_may_stand_and_look_anywhere():
    wall, T_world_sensor = (Box((1, 100, 100)), SE3.trans(x_m=3.5)), SE3.trans(1.0, 2.0, 3.0) @ SE3.rot("z", -0.5)
    raycaster = EmbreeRaycaster(FORWARD, 0.2)
    raycaster.set_bodies([mesh_of(wall[0])])
    hits = raycaster.cast(T_world_sensor, [wall[1]])
    np.testing.assert_allclose(hits.range_m[0], [2.0 / np.cos(0.5), 2.0 / np.sin(0.5)], atol=1e-5)
    np.testing.assert_allclose(hits.cos_incidence[0], [np.cos(0.5), np.sin(0.5)], atol=1e-6)


def test_one_pose_a_body():
    raycaster = EmbreeRaycaster(FORWARD, 0.2)
    raycaster.set_bodies([mesh_of(Box((1, 1, 1)))])
    with pytest.raises(ValueError, match="argument"):
        raycaster.cast(SE3.identity(), [])
