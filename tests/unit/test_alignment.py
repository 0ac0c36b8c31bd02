import numpy as np
import pytest

from services.evaluator.alignment import Alignment, aligned, umeyama
from shared.geometry import SE3

T_B_A = SE3.trans(1.0, -2.0, 3.0) @ SE3.rot("z", 2.0) @ SE3.rot("x", -1.0)
POINTS = np.random.default_rng(2).uniform(-5, 5, (20, 3))


def test_umeyama_recovers_a_transform():
    np.testing.assert_allclose(umeyama(POINTS, T_B_A.apply(POINTS)).matrix, T_B_A.matrix, atol=1e-12)


def test_umeyama_never_mirrors():
    flat = POINTS * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(umeyama(flat, T_B_A.apply(flat)).matrix, T_B_A.matrix, atol=1e-12)
    mirrored = umeyama(POINTS, POINTS * [1.0, 1.0, -1.0])
    assert np.linalg.det(mirrored.rotation) == pytest.approx(1.0)


def test_umeyama_spreads_an_error_over_all():
    """Two of four corners of a square moved outwards by 2 d along x: the square moves by the mean, d."""
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    moved = square + np.array([[0.0], [0.1], [0.1], [0.0]]) * [1.0, 0.0, 0.0]
    np.testing.assert_allclose(umeyama(square, moved).matrix, SE3.trans(0.05).matrix, atol=1e-12)


def test_positions_on_a_line_are_refused():
    with pytest.raises(ValueError, match="lie on a line"):
        umeyama(np.arange(9.0)[:, None] * [1.0, 2.0, 3.0], np.arange(9.0)[:, None] * [0.0, 1.0, 0.0])
    with pytest.raises(ValueError, match="lie on a line"):
        umeyama(np.zeros((1, 3)), np.zeros((1, 3)))


def test_each_alignment_lays_what_it_says_together():
    true = [SE3.exp(twist) for twist in np.random.default_rng(3).normal(size=(5, 6))]
    estimated = [T_B_A.inv() @ pose for pose in true]
    for alignment in (Alignment.FIRST, Alignment.UMEYAMA):
        np.testing.assert_allclose(aligned(alignment, estimated, true).matrix, T_B_A.matrix, atol=1e-9)
    np.testing.assert_array_equal(aligned(Alignment.NONE, estimated, true).matrix, np.eye(4))
    with pytest.raises(ValueError, match="no poses"):
        aligned(Alignment.FIRST, [], [])
