import numpy as np

from services.evaluator.association import by_index, by_stamp, is_indexed
from shared.geometry import SE3


def poses(*stamps_ns):
    return [(stamp_ns, SE3.identity()) for stamp_ns in stamps_ns]


def test_the_nearest_in_time_belong_together():
    pairs = by_stamp(poses(0, 95, 210, 1000), poses(0, 100, 200, 300), max_dt_ns=10)
    np.testing.assert_array_equal(pairs, [[0, 0], [1, 1], [2, 2]])


def test_a_true_pose_goes_to_the_nearest_of_several_estimates():
    np.testing.assert_array_equal(by_stamp(poses(90, 98, 105), poses(100), max_dt_ns=50), [[1, 0]])


def test_estimates_may_lie_beyond_both_ends():
    np.testing.assert_array_equal(by_stamp(poses(0, 50, 60), poses(10, 50), max_dt_ns=10), [[0, 0], [1, 1]])


def test_nothing_near_gives_no_pairs():
    assert by_stamp(poses(0), poses(100), max_dt_ns=99).shape == (0, 2)
    assert by_stamp(poses(), poses(100), max_dt_ns=99).shape == (0, 2)
    assert by_stamp(poses(1), poses(), max_dt_ns=99).shape == (0, 2)


def test_stamps_may_count_the_true_poses():
    estimated = poses(0, 2 * 10**9, 3 * 10**9)
    assert is_indexed(estimated, num_true=4)
    assert not is_indexed(estimated, num_true=3)
    assert not is_indexed(poses(0, 15 * 10**8), num_true=4)
    np.testing.assert_array_equal(by_index(estimated, poses(5, 6, 7, 8)), [[0, 0], [1, 2], [2, 3]])
