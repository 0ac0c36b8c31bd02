import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from services.mapper.filters import range_gate, thinned, voxel_centroids, voxel_keys
from services.mapper.voxel_map import VoxelMap
from shared.runtime.config import MapperConfig

clouds = arrays(np.float64, st.tuples(st.integers(0, 40), st.just(3)), elements=st.floats(-50, 50))


def test_the_gate_keeps_what_lies_between():
    points = np.array([[0.1, 0, 0], [0, 0.5, 0], [0, 0, -3.0], [4.0, 4.0, 4.0]])
    np.testing.assert_array_equal(range_gate(points, 0.5, 3.0), points[1:3])


def test_each_voxel_gives_the_mean_of_its_points():
    points = np.array([[0.01, 0.0, 0.0], [0.09, 0.08, 0.0], [0.11, 0.0, 0.0], [-0.01, 0.0, 0.0]])
    expected = [[-0.01, 0.0, 0.0], [0.05, 0.04, 0.0], [0.11, 0.0, 0.0]]
    np.testing.assert_allclose(voxel_centroids(points, 0.1), expected)


@given(clouds)
def test_the_order_of_the_points_does_not_matter(points):
    shuffled = np.random.default_rng(0).permutation(points)
    np.testing.assert_allclose(voxel_centroids(points, 0.5), voxel_centroids(shuffled, 0.5), atol=1e-9)


@given(clouds)
def test_a_voxel_has_one_point_and_a_point_one_voxel(points):
    keys = voxel_keys(points, 0.5)
    assert len(voxel_centroids(points, 0.5)) == len(set(keys.tolist()))
    voxels = VoxelMap(0.5, max_voxels=1000)
    voxels.insert(points)
    assert len(voxels) == len(set(keys.tolist()))


def test_points_too_far_to_number_are_refused():
    with pytest.raises(ValueError, match=r"too far for voxels of 0\.001 m"):
        voxel_keys(np.array([[2000.0, 0, 0]]), 0.001)


def test_every_voxel_has_a_key_of_its_own():
    cells = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 3), axis=-1).reshape(-1, 3)
    assert len(set(voxel_keys(cells + 0.5, 1.0).tolist())) == 7**3


def test_nothing_stays_nothing():
    assert thinned(np.empty((0, 3), dtype=np.float32), MapperConfig()).shape == (0, 3)


def test_the_map_averages_until_a_voxel_is_settled():
    voxels = VoxelMap(1.0, max_voxels=10)
    for value in (0.2, 0.4):
        voxels.insert(np.array([[value, 0.5, 0.5]]))
    np.testing.assert_allclose(voxels.points_m, [[0.3, 0.5, 0.5]])
    for _ in range(50):
        voxels.insert(np.array([[0.3, 0.5, 0.5]]))
    settled = voxels.points_m
    voxels.insert(np.full((100, 3), 0.9))
    np.testing.assert_array_equal(voxels.points_m, settled)


def test_the_map_is_bounded():
    voxels = VoxelMap(1.0, max_voxels=10)
    voxels.insert(np.arange(90.0).reshape(30, 3))
    voxels.insert(np.arange(90.0).reshape(30, 3))
    assert len(voxels) == len(voxels.points_m) == 10


def test_a_full_map_leaves_its_voxels_alone():
    voxels = VoxelMap(1.0, max_voxels=1024)
    voxels.insert(np.column_stack([np.arange(1024.0), np.zeros(1024), np.zeros(1024)]))
    before = voxels.points_m
    voxels.insert(np.full((5, 3), -7.0))
    np.testing.assert_array_equal(voxels.points_m, before)
