import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from services.mapper.voxel_map import VoxelMap, voxel_centroids
from services.mapper.voxel_table import VoxelTable

clouds = arrays(np.float64, st.tuples(st.integers(0, 40), st.just(3)), elements=st.floats(-50, 50))


def cells_of(points, voxel_size_m):
    return {tuple(cell) for cell in np.floor(points / voxel_size_m).tolist()}


def test_each_voxel_gives_the_mean_of_its_points():
    points = np.array([[0.01, 0.0, 0.0], [-0.01, 0.0, 0.0], [0.09, 0.08, 0.0], [0.11, 0.0, 0.0]])
    expected = [[0.05, 0.04, 0.0], [-0.01, 0.0, 0.0], [0.11, 0.0, 0.0]]
    np.testing.assert_allclose(voxel_centroids(points, 0.1), expected)


@given(clouds)
def test_the_order_of_the_points_does_not_matter(points):
    shuffled = np.random.default_rng(0).permutation(points)
    as_rows = [np.sort(voxel_centroids(cloud, 0.5).round(9).view("f8,f8,f8"), axis=0) for cloud in (points, shuffled)]
    np.testing.assert_array_equal(*as_rows)


@given(clouds)
def test_a_voxel_has_one_point_and_a_point_one_voxel(points):
    assert len(voxel_centroids(points, 0.5)) == len(cells_of(points, 0.5))
    voxels = VoxelMap(0.5, max_voxels=1000)
    voxels.insert(points)
    assert len(voxels) == len(cells_of(points, 0.5))


def test_points_too_far_to_number_are_refused():
    voxels = VoxelMap(0.001, max_voxels=10)
    with pytest.raises(ValueError, match=r"2000 m: too far for voxels of 0\.001 m"):
        voxels.insert(np.array([[0.0, 0, 0], [2000.0, 0, 0]]))
    assert len(voxels) == 0


def test_every_voxel_has_a_number_of_its_own_and_keeps_it():
    cells = np.stack(np.meshgrid(*[np.arange(-8.0, 8.0)] * 3), axis=-1).reshape(-1, 3) + 0.5
    table = VoxelTable(1.0, max_voxels=10_000)
    parts = [table.rows(cells[k : k + 100]) for k in range(0, len(cells), 100)]
    np.testing.assert_array_equal(np.concatenate(parts), np.arange(16**3))
    np.testing.assert_array_equal(table.rows(cells[::-1] + 0.4), np.arange(16**3)[::-1])


def test_without_room_there_is_no_number():
    table = VoxelTable(1.0, max_voxels=2)
    assert table.rows(np.array([[0.5, 0, 0], [1.5, 0, 0], [2.5, 0, 0], [1.6, 0, 0]])).tolist() == [0, 1, -1, 1]


def test_nothing_stays_nothing():
    assert voxel_centroids(np.empty((0, 3), dtype=np.float32), 0.1).shape == (0, 3)
    voxels = VoxelMap(0.1, max_voxels=10)
    voxels.insert(np.empty((0, 3)))
    assert voxels.points_m.shape == (0, 3)


def test_the_map_averages_until_a_voxel_is_settled():
    voxels = VoxelMap(1.0, max_voxels=10)
    for value in (0.2, 0.4):
        voxels.insert(np.array([[value, 0.5, 0.5]]))
    np.testing.assert_allclose(voxels.points_m, [[0.3, 0.5, 0.5]])
    voxels.insert(np.full((100, 3), 0.9))
    np.testing.assert_allclose(voxels.points_m, [[(0.6 + 18 * 0.9) / 20, (1.0 + 18 * 0.9) / 20, (1.0 + 18 * 0.9) / 20]])
    settled = voxels.points_m
    voxels.insert(np.full((100, 3), 0.1))
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
