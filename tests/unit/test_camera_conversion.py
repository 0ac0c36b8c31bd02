import numpy as np
import pytest

from services.sensors.rays.camera_conversion import CameraConversion
from services.sensors.rays.embree import EmbreeBackend
from services.sensors.rays.interface import NO_FACE
from services.sensors.scene import scene_of
from shared.geometry import SE3
from shared.meshes import mesh_of
from shared.solids import Box, Cylinder, Sphere
from tests.support.camera_views import original_world, pinhole, poses, random_view, scene_of_solids

CAMERA = pinhole(320, 180)
HERE = SE3.identity()


def drawn(scene, T_world_camera=HERE, near_m=0.05, far_m=50.0, camera=CAMERA, T_world_link=None):
    conversion = CameraConversion()
    conversion.set_scene(scene)
    return conversion.image(camera, poses(scene, T_world_camera, T_world_link), near_m, far_m)


def num_different(hits, reference):
    """Pixels that differ by more than 1 mm, or where only one of both meets anything; each must be on an outline."""
    is_far = np.isinf(hits.range_m) & np.isinf(reference.range_m)
    with np.errstate(invalid="ignore"):
        different = np.argwhere(~is_far & ~(np.abs(hits.range_m - reference.range_m) <= 1e-3))
    for v, u in different:
        around = reference.range_m[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
        assert np.isclose(hits.range_m[v, u], around, rtol=0.02).any()
    return len(different)


def compare(scene, views, clips, T_world_link=None):
    """Share of pixels that differ between the backends, and the share of pixels that meet anything."""
    conversion, embree = CameraConversion(), EmbreeBackend()
    conversion.set_scene(scene)
    embree.set_scene(scene)
    different, met = 0, []
    for view, (near_m, far_m) in zip(views, clips, strict=True):
        at = poses(scene, view, T_world_link)
        hits, reference = (backend.image(CAMERA, at, near_m, far_m) for backend in (conversion, embree))
        different += num_different(hits, reference)
        is_same = hits.face == reference.face
        np.testing.assert_allclose(hits.cos_incidence[is_same], reference.cos_incidence[is_same], atol=2e-4)
        np.testing.assert_array_equal(hits.face == NO_FACE, np.isinf(hits.range_m))
        met.append(np.isfinite(reference.range_m).mean())
    return different / (len(views) * CAMERA.height * CAMERA.width), np.mean(met)


def test_the_original_world_is_seen_as_by_embree():
    scene, T_world_link = original_world()
    rng = np.random.default_rng(2)
    views = [
        random_view(rng, np.array([0.0, -0.7, 10.8]), spread_m) for spread_m in (0.15, 0.5, 1.5) for _ in range(20)
    ]
    clips = [(rng.choice([0.05, 0.2, 0.5]), rng.choice([3.0, 10.0, 65.0])) for _ in views]
    different, met = compare(scene, views, clips, T_world_link)
    assert different <= 1e-5
    assert met > 0.2


def test_within_solids_and_across_the_near_plane_backs_are_seen():
    scene = scene_of_solids(
        (Box((1.0, 1.0, 1.0)), HERE),
        (Cylinder(0.3, 1.5), SE3.from_rpy((0.4, 0.2, 0.0))),
        (Sphere(0.25), SE3.trans(0.4, 0.3, 0.2)),
        (mesh_of(Box((0.2, 3.0, 0.2))), SE3.from_rpy((0.1, 0.3, 0.2))),
    )
    rng = np.random.default_rng(3)
    views = [random_view(rng, np.zeros(3), 0.3) for _ in range(30)]
    different, met = compare(scene, views, [(rng.choice([0.02, 0.2, 0.5]), 20.0) for _ in views])
    assert different <= 1e-5
    assert met > 0.5


def test_a_tilted_wall_has_the_depths_of_its_plane():
    tilt = np.deg2rad(30)
    T_world_wall = SE3.trans(z_m=2.0) @ SE3.rot("y", tilt)
    hits = drawn(scene_of_solids((Box((60.0, 60.0, 0.002)), T_world_wall @ SE3.trans(z_m=0.001))))
    rays, normal = CAMERA.rays(), T_world_wall.rotation[:, 2]
    np.testing.assert_allclose(hits.range_m, 2.0 * normal[2] / (rays @ normal), rtol=3e-7)
    cosines = (rays @ normal) / np.linalg.norm(rays, axis=-1)
    np.testing.assert_allclose(hits.cos_incidence, cosines, atol=1e-5)
    assert (hits.face == 4).all()


def test_the_pixels_of_a_square_are_those_whose_centre_it_covers():
    camera = pinhole(101, 101, fov_deg=90.0)  # 50.5 px focal length: 1.01 m at a depth of 1 m is 51 px across
    hits = drawn(scene_of_solids((Box((1.01, 1.01, 0.1)), SE3.trans(z_m=1.05))), camera=camera)
    rows, columns = np.nonzero(np.isfinite(hits.range_m))
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (25, 75, 25, 75)
    assert len(rows) == 51 * 51


def test_a_bar_thinner_than_a_pixel_is_met_where_it_covers_centres():
    camera = pinhole(101, 101, fov_deg=90.0)
    bar = Box((0.5 / 50.5, 10.0, 0.001))
    assert np.isfinite(drawn(scene_of_solids((bar, SE3.trans(z_m=1.0))), camera=camera).range_m[:, 50]).all()
    between = SE3.trans(x_m=0.5 / 50.5, z_m=1.0)
    assert np.isinf(drawn(scene_of_solids((bar, between)), camera=camera).range_m).all()


@pytest.mark.parametrize(("near_m", "depth_m"), [(0.5, 1.0), (1.2, 2.0), (2.1, 4.0), (4.6, 5.0)])
def test_rays_begin_at_the_near_depth(near_m, depth_m):
    near, far = (Box((9.0, 9.0, 1.0)), SE3.trans(z_m=1.5)), (Box((9.0, 9.0, 1.0)), SE3.trans(z_m=4.5))
    hits = drawn(scene_of_solids(near, far), near_m=near_m)
    assert hits.range_m[90, 160] == pytest.approx(depth_m, abs=1e-6)


def test_what_is_beyond_the_far_depth_is_not_met():
    scene = scene_of_solids((Box((9.0, 9.0, 1.0)), SE3.trans(z_m=3.5)))
    assert np.isfinite(drawn(scene, far_m=3.0001).range_m).all()
    hits = drawn(scene, far_m=2.999)
    assert np.isinf(hits.range_m).all()
    assert (hits.face == NO_FACE).all()
    assert not hits.cos_incidence.any()


def test_what_is_behind_or_beside_the_camera_is_not_met():
    for place in (SE3.trans(z_m=-2.0), SE3.trans(x_m=4.0, z_m=1.0), SE3.trans(y_m=-4.0, z_m=1.0)):
        assert np.isinf(drawn(scene_of_solids((Box((1.0, 1.0, 1.0)), place))).range_m).all()


def test_links_move_from_image_to_image():
    scene = scene_of_solids((Box((9.0, 9.0, 1.0)), HERE))
    conversion = CameraConversion()
    conversion.set_scene(scene)
    depths = [
        conversion.image(CAMERA, poses(scene, HERE, {"world": SE3.trans(z_m=z)}), 0.05, 9.0).range_m[0, 0]
        for z in (2.5, 4.5)
    ]
    np.testing.assert_allclose(depths, [2.0, 4.0], rtol=1e-6)


def test_an_empty_scene_and_none():
    assert np.isinf(drawn(scene_of(())).range_m).all()
    with pytest.raises(ValueError, match="set_scene comes first"):
        CameraConversion().image(CAMERA, poses(scene_of(()), HERE), 0.1, 1.0)
