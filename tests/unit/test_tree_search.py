from itertools import pairwise

import numpy as np
import pytest

from services.planner.tree_search import find_path, shortened, without_needless

SCALE = np.ones(8)
START, GOAL, OTHER = np.zeros(8), np.array([2.0, 0, 0, 0, 0, 0, 0, 0]), np.array([2.0, 1.0, 0, 0, 0, 0, 0, 0])


def is_way_free(a, b):
    """A wall at x = 1 with a door at y above 0.5."""
    points = a + np.linspace(0, 1, 50)[:, None] * (b - a)
    return not ((np.abs(points[:, 0] - 1) < 0.1) & (points[:, 1] < 0.5)).any()


def is_path_free(path):
    return all(is_way_free(a, b) for a, b in pairwise(path))


def draw_from(seed):
    rng = np.random.default_rng(seed)
    return lambda: np.concatenate([rng.uniform([-1, -1], [3, 2]), np.zeros(6)])


@pytest.mark.parametrize("seed", range(5))
def test_it_finds_the_door(seed):
    path = find_path(START, GOAL[None], SCALE, is_way_free, draw_from(seed), 2000)
    assert (path[0] == START).all()
    assert (path[-1] == GOAL).all()
    assert is_path_free(path)


def test_any_of_several_goals_will_do():
    ends = [
        find_path(START, np.array([GOAL, OTHER]), SCALE, is_way_free, draw_from(seed), 2000)[-1] for seed in range(8)
    ]
    assert {tuple(end) for end in ends} <= {tuple(GOAL), tuple(OTHER)}


def test_without_a_way_it_ends_after_the_iterations():
    draws = []
    draw = draw_from(0)
    assert find_path(START, GOAL[None], SCALE, lambda a, b: False, lambda: draws.append(0) or draw(), 17) is None
    assert len(draws) == 17


def test_detours_are_cut_off_and_the_ends_stay():
    path = find_path(START, GOAL[None], SCALE, is_way_free, draw_from(1), 2000)
    short = shortened(path, is_way_free, np.random.default_rng(0), 200)
    length, before = (np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in (short, path))
    assert length <= before
    assert length < 1.35 * 2 * np.hypot(1, 0.5)
    assert is_path_free(short)
    assert (short[[0, -1]] == path[[0, -1]]).all()


def test_points_on_a_straight_line_are_needless():
    points = list(np.linspace(START, OTHER, 9))
    assert len(without_needless(points, lambda a, b: True)) == 2
    assert len(without_needless(points, lambda a, b: False)) == 9
