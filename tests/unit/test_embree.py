"""The backend that casts rays, against closed forms; the other one is tested against it."""

import numpy as np
import pytest

from services.sensors.depth.pinhole import Pinhole
from services.sensors.lidar.beams import Beams, uniform_beams
from services.sensors.lidar.footprint import Footprint, sub_rays
from services.sensors.rays.embree import EmbreeBackend
from services.sensors.rays.interface import NO_FACE, Poses
from services.sensors.scene import scene_of
from shared.geometry import SE3
from shared.robot.description import Shape
from shared.solids import Box, Sphere

FORWARD = uniform_beams(1, 0.0, 0.0, 4)
"""Four beams: along x, -y, -x, y."""


def backend(*solids):
    shapes = [Shape(f"link{i}", solid, SE3.identity()) for i, solid in enumerate(solids)]
    embree = EmbreeBackend()
    embree.set_scene(scene_of(shapes))
    return embree


def poses(*links, sensor=None):
    sensors = sensor if isinstance(sensor, list) else [sensor or SE3.identity()]
    return Poses(
        np.stack([pose.rotation for pose in sensors]),
        np.stack([pose.translation for pose in sensors]),
        np.stack([[pose.rotation for pose in links]]),
        np.stack([[pose.translation for pose in links]]),
    )


def test_a_wall_is_met_at_its_distance_face_and_angle():
    turned = uniform_beams(1, 30.0, 30.0, 4)
    hits = backend(Box((1, 100, 100))).scan(turned, poses(SE3.trans(x_m=3.5)), 0.0, 100.0)
    assert hits.range_m[0, 0] == pytest.approx(3.0 / np.cos(np.pi / 6), abs=1e-5)
    assert hits.cos_incidence[0, 0] == pytest.approx(np.cos(np.pi / 6), abs=1e-6)
    assert hits.face[0, 0] == 0


def test_the_whole_pattern_meets_the_room_around_it():
    beams = uniform_beams(16, 22.8, -22.8, 32)
    hits = backend(Box((10, 10, 10))).scan(beams, poses(SE3.identity()), 0.0, 100.0)
    np.testing.assert_allclose(hits.range_m, 5.0 / np.abs(beams.directions()).max(axis=-1), atol=1e-4)


def test_the_first_face_in_the_way_is_the_one_that_is_met():
    hits = backend(Sphere(1.0), Box((1, 1, 1))).scan(FORWARD, poses(SE3.trans(x_m=6.0), SE3.trans(x_m=2.5)), 0.0, 100.0)
    assert hits.range_m[0, 0] == pytest.approx(2.0, abs=1e-5)
    assert hits.face[:, 0].tolist() == [512, NO_FACE, NO_FACE, NO_FACE]
    assert np.isinf(hits.range_m[1, 0])
    assert hits.cos_incidence[1, 0] == 0


def test_rays_begin_and_end_where_they_are_told():
    embree, here = backend(Sphere(0.1), Box((1, 1, 1))), poses(SE3.identity(), SE3.trans(x_m=2.5))
    assert embree.scan(FORWARD, here, 0.2, 100.0).range_m[0, 0] == pytest.approx(2.0, abs=1e-5)
    assert embree.scan(FORWARD, here, 0.0, 100.0).range_m[0, 0] == pytest.approx(0.1, abs=1e-3)
    assert embree.scan(FORWARD, here, 0.2, 1.9).face[0, 0] == NO_FACE


def test_a_pose_a_column():
    T_world_sensor = [SE3.trans(x_m=0.1 * i) @ SE3.rot("z", np.pi / 2 * i) for i in range(4)]
    hits = backend(Box((1, 100, 100))).scan(FORWARD, poses(SE3.trans(x_m=3.5), sensor=T_world_sensor), 0.0, 100.0)
    np.testing.assert_allclose(hits.range_m[:, 0], [3.0, 2.9, 2.8, 2.7], atol=1e-5)


def test_links_move_from_block_to_block():
    here = poses(SE3.trans(x_m=3.5))
    shift = np.array([0.0, 0.0, 0.5, 0.5])[:, np.newaxis, np.newaxis] * np.array([1.0, 0, 0])
    moved = Poses(
        np.stack([SE3.rot("z", np.pi / 2 * i).rotation for i in range(4)]),
        np.zeros((4, 3)),
        np.repeat(here.link_rotation, 2, axis=0),
        here.link_translation_m + shift[[0, 2]],
    )
    hits = backend(Box((1, 100, 100))).scan(FORWARD, moved, 0.0, 100.0)
    np.testing.assert_allclose(hits.range_m[:, 0], [3.0, 3.0, 3.5, 3.5], atol=1e-5)


def test_beams_begin_where_they_leave_the_sensor():
    beams = Beams(np.zeros(1), np.array([np.pi / 2]), 0.2, SE3.identity(), 4)
    hits = backend(Box((100, 1, 100))).scan(beams, poses(SE3.trans(y_m=3.5)), 0.0, 100.0)
    assert hits.range_m[0, 0] == pytest.approx(3.0, abs=1e-5)
    hits = backend(Box((1, 100, 100))).scan(beams, poses(SE3.trans(x_m=3.5)), 0.0, 100.0)
    assert hits.range_m[1, 0] == pytest.approx(3.0, abs=1e-5)


def test_an_image_holds_depths():
    camera = Pinhole(3, 5, 2.0, 2.0, 2.0, 1.0)
    hits = backend(Box((100, 100, 1))).image(camera, poses(SE3.trans(z_m=3.5)), 0.1, 100.0)
    np.testing.assert_allclose(hits.range_m, 3.0, atol=1e-5)
    assert hits.cos_incidence[1, 2] == pytest.approx(1.0)
    assert hits.cos_incidence[0, 0] == pytest.approx(1 / np.linalg.norm([1, 0.5, 1]))
    assert (backend(Box((100, 100, 1))).image(camera, poses(SE3.trans(z_m=3.5)), 0.1, 2.9).face == NO_FACE).all()


def test_sub_rays_spread_evenly_over_the_beam():
    rays = sub_rays()
    np.testing.assert_allclose(rays.mean(axis=0), 0, atol=1e-12)
    assert (np.linalg.norm(rays, axis=1) <= 1).all()
    second_moment = (rays**2).sum(axis=1).mean()
    assert second_moment == pytest.approx(0.5, abs=0.06), "of an even disc it is a half"


def test_only_beams_near_an_edge_are_split():
    wall = backend(Box((1, 4, 100)))
    beams = uniform_beams(1, 0.0, 0.0, 3600)
    footprint = Footprint(0.01, np.deg2rad(0.18))
    edges = wall.edges(beams, poses(SE3.trans(x_m=3.5)), 0.0, 100.0, footprint)
    azimuth = np.rad2deg(beams.encoder_rad[edges.cells])
    edge_deg = np.rad2deg(np.arctan2(2.0, 3.0))
    width_deg = 0.09 + np.rad2deg(0.005 / np.hypot(2.0, 3.0))
    from_edge_deg = np.abs(np.abs((azimuth + 180) % 360 - 180) - edge_deg)
    assert 2 <= len(edges.cells) <= 8
    assert from_edge_deg.max() < width_deg
    assert set((edges.face >= 0).sum(axis=1).tolist()) <= {1, 2, 3, 4, 5, 6}


def test_no_scene_and_an_empty_scene():
    with pytest.raises(ValueError, match="set_scene"):
        EmbreeBackend().scan(FORWARD, poses(SE3.identity()), 0.0, 1.0)
    empty = EmbreeBackend()
    empty.set_scene(scene_of([]))
    assert (empty.scan(FORWARD, poses(SE3.identity()), 0.0, 1.0).face == NO_FACE).all()
