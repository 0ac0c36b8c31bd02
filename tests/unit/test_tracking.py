"""The tracker with the real GICP in a corner of three walls, a stage at a time."""

import numpy as np

from services.mapper.matching import make_matcher
from services.mapper.tracking import Tracker
from shared.geometry import SE3
from shared.runtime.config import MapperConfig

CONFIG = MapperConfig(method="gicp", keyframe_novelty=1.0)
NEAR_ONLY = CONFIG.model_copy(update={"search_correspondence_m": 0.1})
"""The wider search sees no farther than the first attempt."""


def corner(seed=1, num=600):
    """Points on three walls of 2 m that meet at (-1, -1, -1), in the map frame."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (3 * num, 3))
    for axis in range(3):
        points[axis * num : (axis + 1) * num, axis] = -1.0
    return points + 0.003 * rng.standard_normal(points.shape)


def misleading():
    """The corner and a new wall in front of one of its walls: a wide search lays the known one between the two."""
    new_wall = np.random.default_rng(3).uniform(-1, 1, (500, 3)) * [0, 1, 1] + [-0.6, 0, 0]
    return np.vstack([corner(seed=2), new_wall])


class Run:
    """A tracker that is shown the corner from one true pose after the other; it is told what step to expect."""

    def __init__(self, config=CONFIG, **settings):
        config = config.model_copy(update=settings)
        matcher = make_matcher(config)
        matcher.start(corner(), SE3.identity())
        self.tracker = Tracker(config, matcher, SE3.identity())

    def see(self, T_map_sensor, points_map_m=None, step=None):
        points_map_m = corner(seed=2) if points_map_m is None else points_map_m
        return self.show(T_map_sensor.inv().apply(points_map_m), step)

    def show(self, points_m, step=None):
        return self.tracker.follow(points_m, step or SE3.identity())


def error_m(track, T_map_sensor):
    return np.linalg.norm((T_map_sensor.inv() @ track.T_map_sensor).translation)


def test_a_blind_scan_stays_where_it_was_predicted():
    run, step = Run(), SE3.trans(x_m=0.05)
    for k in (1, 2, 3):
        assert run.see(SE3.trans(x_m=0.05 * k), step=step).is_tracking
    first, second = run.show(np.empty((0, 3)), step), run.show(np.empty((0, 3)))
    assert (first.is_tracking, second.is_tracking) == (False, False)
    assert error_m(first, SE3.trans(x_m=0.2)) < 0.003
    np.testing.assert_array_equal(second.T_map_sensor.matrix, first.T_map_sensor.matrix)


def test_what_a_scan_leaves_open_is_held_by_the_prediction():
    wall = corner()[:600]
    wall = wall[(np.abs(wall[:, 1:]) < 0.8).all(axis=1)]
    run = Run()
    track = run.show(wall, SE3.trans(y_m=0.03, z_m=-0.02))
    assert track.is_tracking
    assert track.degenerate_axes == ("y", "z", "roll")
    np.testing.assert_allclose(track.T_map_sensor.translation, [0.0, 0.03, -0.02], atol=0.002)


def test_a_sudden_stop_is_found_from_where_it_stood():
    """The prediction overshoots by 51 degrees, and the wide search is misled."""
    run = Run(max_jump_deg=60.0)
    for k in range(1, 16):
        assert run.see(SE3.rot("z", 0.06 * k * (k + 1) / 2), step=SE3.rot("z", 0.06 * k)).is_tracking
    stopped = SE3.rot("z", 0.06 * 120)
    track = run.see(stopped, misleading(), step=SE3.rot("z", 0.9))
    assert track.is_tracking
    assert error_m(track, stopped) < 0.003


def test_a_sudden_turn_is_found_by_the_wider_search():
    turned = SE3.rot("z", 0.8)
    assert not Run(NEAR_ONLY).see(turned).is_tracking
    track = Run(max_jump_deg=60.0).see(turned)
    assert track.is_tracking
    assert error_m(track, turned) < 0.003


def test_the_best_attempt_counts_and_not_the_last():
    track = Run().see(SE3.identity(), misleading())
    assert track.is_tracking
    assert error_m(track, SE3.identity()) < 0.003


def test_what_does_not_fit_is_not_believed_however_near():
    noise = np.random.default_rng(4).uniform(-1, 1, (2000, 3))
    assert not Run(max_jump_m=100.0, max_jump_deg=180.0).show(noise).is_tracking


def test_a_jump_is_believed_only_when_it_persists():
    run = Run(max_jump_m=0.2)
    assert run.see(SE3.trans(x_m=0.01)).is_tracking
    for away in (SE3.trans(x_m=0.35), SE3.identity()):
        refused, believed = run.see(away), run.see(away)
        assert (refused.is_tracking, believed.is_tracking) == (False, True)
        assert error_m(believed, away) < 0.003
        assert run.see(away).is_tracking
