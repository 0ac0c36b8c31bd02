import numpy as np
import pytest

from services.sensors.lidar.beams import Beams, uniform_beams
from services.sensors.lidar.footprint import Footprint
from services.sensors.rays.embree import EmbreeBackend
from services.sensors.rays.interface import NO_FACE, Hits, Poses
from services.sensors.rays.lidar_conversion import LidarConversion
from services.sensors.scene import Scene, scene_of
from shared.geometry import SE3
from shared.meshes import cylinder
from shared.robot.description import Shape
from shared.robot.urdf import parse_urdf
from shared.solids import Box, Cylinder, Mesh, Sphere
from shared.world.urdf_format import structure_urdf
from tests.support.robots import MODEL, ORIGINAL

NUM_COLUMNS = 128
_PLACE_M = np.array([0.0, -0.8, 10.4])
FOOTPRINT = Footprint(exit_m=0.01, divergence_rad=np.deg2rad(0.18))


def shape(solid, *xyz_m, rpy_rad=(0, 0, 0), link="world"):
    return Shape(link, solid, SE3.from_rpy(rpy_rad, xyz_m or (0, 0, 0)))


def original() -> Scene:
    structure = parse_urdf(structure_urdf(ORIGINAL), "original").shapes
    return scene_of([*structure, *MODEL.shapes])


def uniform() -> Beams:
    return uniform_beams(128, 22.8, -22.8, NUM_COLUMNS)


def staggered(rng: np.random.Generator) -> Beams:
    """Like a real unit's: four azimuths, each with its spread, an origin off the axis, a turned mount."""
    azimuth_rad = np.deg2rad(np.tile([-4.21, -1.41, 1.4, 4.22], 32) + rng.uniform(-0.02, 0.02, 128))
    elevation_rad = np.deg2rad(np.linspace(21, -21.8, 128) + rng.uniform(-0.04, 0.04, 128))
    T_sensor_lidar = SE3.from_rpy((0, 0, np.pi), (0, 0, 0.03618))
    return Beams(elevation_rad, azimuth_rad, 0.015806, T_sensor_lidar, NUM_COLUMNS)


def scattered(rng: np.random.Generator, scene: Scene) -> list[SE3]:
    """Poses of links about the robot's place, the world's link where it belongs."""
    near = [SE3.from_rpy(rng.uniform(-3, 3, 3), _PLACE_M + rng.uniform(-0.4, 0.4, 3)) for _ in scene.links]
    return [SE3.identity() if link == "world" else pose for link, pose in zip(scene.links, near, strict=True)]


def stacked(poses: list[SE3]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([pose.rotation for pose in poses]), np.array([pose.translation for pose in poses])


def at_rest(T_world_sensor: SE3, links: list[SE3]) -> Poses:
    R, t = stacked(links)
    return Poses(
        T_world_sensor.rotation[np.newaxis], T_world_sensor.translation[np.newaxis], R[np.newaxis], t[np.newaxis]
    )


def on_the_move(rng: np.random.Generator, start: SE3, links: list[SE3], num_blocks: int = 3) -> Poses:
    """Turns by up to 0.2 rad and goes up to 0.2 m on the way; so do the links that are not the first."""
    twist = rng.uniform(-0.2, 0.2, 6)
    R, t = stacked([start @ SE3.exp(c / NUM_COLUMNS * twist) for c in range(NUM_COLUMNS)])
    blocks = [
        stacked([links[0], *(pose @ SE3.exp(b / num_blocks * twist) for pose in links[1:])]) for b in range(num_blocks)
    ]
    return Poses(R, t, np.array([R for R, _ in blocks]), np.array([t for _, t in blocks]))


def random_poses(rng: np.random.Generator, scene: Scene, is_moving: bool) -> Poses:
    start = SE3.from_rpy(rng.uniform(-0.6, 0.6, 3), _PLACE_M + rng.uniform(-1, 1, 3))
    links = scattered(rng, scene)
    return on_the_move(rng, start, links) if is_moving else at_rest(start, links)


def both(scene: Scene) -> tuple[LidarConversion, EmbreeBackend]:
    conversion, reference = LidarConversion(), EmbreeBackend()
    conversion.set_scene(scene)
    reference.set_scene(scene)
    return conversion, reference


def num_different(hits: Hits, truth: Hits) -> int:
    is_same = hits.range_m == truth.range_m
    is_hit = np.isfinite(hits.range_m) & np.isfinite(truth.range_m)
    is_same[is_hit] = np.abs(hits.range_m[is_hit] - truth.range_m[is_hit]) <= 1e-3
    return int((~is_same).sum())


def seen_alone(solid, beams: Beams, T_world_sensor: SE3 | None = None, near_m=0.05, far_m=100.0, xyz_m=(0, 0, 0)):
    conversion, reference = both(scene_of([shape(solid, *xyz_m)]))
    poses = at_rest(T_world_sensor or SE3.identity(), [SE3.identity()])
    hits = conversion.scan(beams, poses, near_m, far_m)
    assert num_different(hits, reference.scan(beams, poses, near_m, far_m)) == 0
    return hits


@pytest.mark.parametrize("is_moving", [False, True])
@pytest.mark.parametrize("is_staggered", [False, True])
def test_scans_are_those_of_the_reference(is_moving, is_staggered):
    rng = np.random.default_rng(3)
    scene = original()
    conversion, reference = both(scene)
    num_rays = different = 0
    for near_m, far_m in [(0.2, 10.0), (0.05, 120.0)] * 4:
        beams = staggered(rng) if is_staggered else uniform()
        poses = random_poses(rng, scene, is_moving)
        hits, truth = (backend.scan(beams, poses, near_m, far_m) for backend in (conversion, reference))
        num_rays += hits.range_m.size
        different += num_different(hits, truth)
        is_same_face = (hits.face == truth.face) & (hits.face != NO_FACE)
        np.testing.assert_allclose(hits.cos_incidence[is_same_face], truth.cos_incidence[is_same_face], atol=1e-4)
        assert is_same_face.sum() > 0.9 * (truth.face != NO_FACE).sum()  # bars of one plane overlap: either may be met
    assert different <= num_rays // 100_000 + 1


def test_a_wall_is_met_at_its_distance_over_the_cosine():
    beams = uniform_beams(3, 10.0, -10.0, 4)
    hits = seen_alone(Box((1.0, 100.0, 100.0)), beams, xyz_m=(3.5, 0, 0))
    np.testing.assert_allclose(hits.range_m[0], 3 / np.cos(beams.elevation_rad), rtol=1e-6)
    np.testing.assert_allclose(hits.cos_incidence[0], np.cos(beams.elevation_rad), rtol=1e-6)
    assert (hits.face[0] == 0).all()
    assert (hits.face[2] == NO_FACE).all()
    assert np.isinf(hits.range_m[2]).all()
    assert (hits.cos_incidence[2] == 0).all()


@pytest.mark.parametrize("is_staggered", [False, True])
def test_from_inside_a_box_its_walls_are_seen(is_staggered):
    beams = staggered(np.random.default_rng(0)) if is_staggered else uniform()
    hits = seen_alone(Box((4.0, 4.0, 3.0)), beams, SE3.trans(0.3, -0.2, 0.1))
    assert np.isfinite(hits.range_m).all()


def test_a_wall_nearer_than_the_near_clip_is_passed_through_and_the_far_one_met():
    hits = seen_alone(Box((2.0, 100.0, 100.0)), uniform(), near_m=0.2, xyz_m=(1.1, 0, 0))
    assert hits.range_m[0].min() == pytest.approx(2.1, rel=1e-4)


def test_nothing_beyond_the_far_clip_is_met():
    assert np.isinf(seen_alone(Box((1.0, 1.0, 1.0)), uniform(), far_m=2.0, xyz_m=(3, 0, 0)).range_m).all()


@pytest.mark.parametrize("xyz_m", [(0, 0, 0.5), (0, 0, -0.5), (0.3, 0, 2), (0, 0, -10)])
def test_faces_across_the_axis(xyz_m):
    seen_alone(Box((0.7, 0.5, 0.1)), uniform(), xyz_m=xyz_m)
    seen_alone(Box((0.7, 0.5, 0.1)), staggered(np.random.default_rng(1)), xyz_m=xyz_m)


def test_corners_exactly_on_columns_and_edges_along_them_leave_no_gap():
    beams = uniform_beams(65, 20.0, -20.0, 8)
    for solid in (Box((2.0, 2.0, 2.0)), cylinder(1.0, 2.0)):
        assert np.isfinite(seen_alone(solid, beams, SE3.trans(-4.0, 0, 0)).range_m[0][30:35]).all()


def test_spheres_tubes_and_meshes_of_thousands_of_triangles():
    rng = np.random.default_rng(2)
    bumps = np.array([[x, y, 0.2 * rng.random()] for x in range(40) for y in range(40)], dtype=float)
    corner = (40 * np.arange(39)[:, np.newaxis] + np.arange(39)).reshape(-1)
    triangles = np.concatenate(
        [np.stack([corner, corner + 40, corner + 41], 1), np.stack([corner, corner + 41, corner + 1], 1)]
    ).astype(np.uint32)
    shapes = [
        shape(Sphere(0.5), 2, 0, 0),
        shape(Cylinder(0.2, 3.0), 0, 2, 0, rpy_rad=(0.4, 0.5, 0)),
        shape(Mesh(bumps, triangles), -20, -20, -1),
    ]
    conversion, reference = both(scene_of(shapes))
    poses = at_rest(SE3.trans(0.1, 0.05, 0.2), [SE3.identity()])
    for beams in (uniform(), staggered(rng)):
        hits, truth = (backend.scan(beams, poses, 0.05, 50.0) for backend in (conversion, reference))
        assert num_different(hits, truth) <= 1


def test_no_face_no_hit_and_a_face_without_area_is_none():
    for shapes in ([], [shape(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], dtype=np.uint32)))]):
        conversion = LidarConversion()
        conversion.set_scene(scene_of(shapes))
        for beams in (uniform(), staggered(np.random.default_rng(0))):
            poses = at_rest(SE3.identity(), [SE3.identity()])
            assert (conversion.scan(beams, poses, 0.1, 10.0).face == NO_FACE).all()
            assert len(conversion.edges(beams, poses, 0.1, 10.0, FOOTPRINT).cells) == 0


def test_a_shape_that_moved_is_met_where_it_is():
    conversion, _ = both(scene_of([shape(Box((1.0, 1.0, 1.0)), link="box")]))
    for distance_m in (3.0, 4.0, 3.0):
        poses = at_rest(SE3.identity(), [SE3.trans(distance_m)])
        hits = conversion.scan(uniform(), poses, 0.1, 10.0)
        assert hits.range_m.min() == pytest.approx(distance_m - 0.5, rel=1e-3)


def test_elevations_must_fall():
    conversion, _ = both(scene_of([]))
    beams = uniform_beams(4, -10.0, 10.0, 8)
    with pytest.raises(ValueError, match="elevation_rad must fall"):
        conversion.scan(beams, at_rest(SE3.identity(), [SE3.identity()]), 0.1, 10.0)


def apart() -> Scene:
    """Shapes none of whose faces lie in one plane, one thinner than the distance of beams, two through each other."""
    rng = np.random.default_rng(6)
    turned = [
        shape(Box(tuple(rng.uniform(0.1, 0.8, 3))), *rng.uniform(-4, 4, 3) * (1, 1, 0.3), rpy_rad=rng.uniform(-3, 3, 3))
        for _ in range(25)
    ]
    thin = shape(Box((0.004, 0.005, 6.0)), 3.1, 0.7, 0.2, rpy_rad=(0.2, 0.1, 0))
    through = [shape(Box((0.3, 0.31, 3.0)), -2.5, 1, 0), shape(Cylinder(0.2, 3.0), -2.5, 1.1, 0, rpy_rad=(1.4, 0.2, 0))]
    ground = shape(Box((30.0, 30.0, 0.1)), 0, 0, -2)
    near = shape(Box((0.05, 0.08, 0.5)), 0.3, 0.05, 0, link="robot")
    return scene_of([ground, thin, *through, *turned, near])


@pytest.mark.parametrize("is_moving", [False, True])
@pytest.mark.parametrize("is_staggered", [False, True])
def test_edges_are_those_of_the_reference(is_moving, is_staggered):
    rng = np.random.default_rng(8)
    conversion, reference = both(apart())
    links = [SE3.identity(), SE3.identity()]
    num_cells = num_wrong = num_rays = 0
    for near_m, far_m in [(0.05, 120.0), (0.2, 4.0)]:
        beams = staggered(rng) if is_staggered else uniform()
        start = SE3.from_rpy(rng.uniform(-0.1, 0.1, 3))
        poses = on_the_move(rng, start, links) if is_moving else at_rest(start, links)
        conversion.scan(beams, poses, near_m, far_m)
        edges, truth = (backend.edges(beams, poses, near_m, far_m, FOOTPRINT) for backend in (conversion, reference))
        assert (np.diff(edges.cells) > 0).all()
        num_cells += len(truth.cells)
        num_wrong += len(np.setxor1d(edges.cells, truth.cells))
        _, ours, theirs = np.intersect1d(edges.cells, truth.cells, return_indices=True)
        is_same = edges.face[ours] == truth.face[theirs]
        num_rays += (~is_same).sum()
        met = is_same & (edges.face[ours] != NO_FACE)
        np.testing.assert_allclose(edges.range_m[ours][met], truth.range_m[theirs][met], atol=1e-3)
        np.testing.assert_allclose(edges.cos_incidence[ours][met], truth.cos_incidence[theirs][met], atol=1e-4)
    assert num_cells > 500
    assert num_wrong <= num_cells // 500
    assert num_rays <= num_cells // 200


def thin_bars(rng: np.random.Generator) -> Scene:
    """Leaning bars of 3 to 60 mm all round, 1 to 50 m away, and one seen nearly end-on."""
    bars = [shape(Box((0.9, 0.01, 0.02)), 1.5, 0.1, 0, rpy_rad=(0, 0, 0.1 / 1.5))]
    for range_m in np.geomspace(1.0, 50.0, 24):
        azimuth_rad, height_m = rng.uniform(-np.pi, np.pi), range_m * rng.uniform(-0.35, 0.35)
        size_m = (*rng.uniform(0.003, 0.06, 2), 0.6 * range_m)
        place_m = range_m * np.cos(azimuth_rad), range_m * np.sin(azimuth_rad), height_m
        bars.append(shape(Box(size_m), *place_m, rpy_rad=rng.uniform(-1.5, 1.5, 3)))
    return scene_of(bars)


@pytest.mark.parametrize("is_staggered", [False, True])
def test_no_edge_of_a_thin_bar_is_missed(is_staggered):
    rng = np.random.default_rng(12)
    num_cells = num_wrong = 0
    for _ in range(4):
        conversion, reference = both(thin_bars(rng))
        beams = staggered(rng) if is_staggered else uniform()
        poses = on_the_move(rng, SE3.from_rpy(rng.uniform(-0.3, 0.3, 3)), [SE3.identity()])
        conversion.scan(beams, poses, 0.05, 120.0)
        ours, theirs = (
            backend.edges(beams, poses, 0.05, 120.0, FOOTPRINT).cells for backend in (conversion, reference)
        )
        num_cells += len(theirs)
        num_wrong += len(np.setxor1d(ours, theirs))
    assert num_cells > 500
    assert num_wrong <= num_cells // 500


def test_a_bar_between_the_beams_is_found_by_their_width():
    conversion, _ = both(scene_of([shape(Box((0.002, 0.002, 2.0)), 5.0 * np.cos(0.02), 5.0 * np.sin(0.02), 0)]))
    beams, poses = uniform(), at_rest(SE3.identity(), [SE3.identity()])
    assert (conversion.scan(beams, poses, 0.1, 10.0).face == NO_FACE).all()
    wide = Footprint(exit_m=0.01, divergence_rad=0.06)
    assert len(conversion.edges(beams, poses, 0.1, 10.0, wide).cells) > 20


def test_a_beam_without_width_has_no_edges():
    conversion, _ = both(apart())
    poses = at_rest(SE3.identity(), [SE3.identity()] * 2)
    conversion.scan(uniform(), poses, 0.1, 10.0)
    assert len(conversion.edges(uniform(), poses, 0.1, 10.0, Footprint(0.0, 0.0)).cells) == 0
