"""A mapper that was killed goes on in its map."""

import numpy as np
import pytest

from services.mapper.mapper import Mapper
from services.mapper.planes.matcher import PlaneMatcher
from services.mapper.state import MapState, PoseState
from shared.geometry import SE3
from shared.messaging.codec import decode, encode
from shared.messaging.messages import Event, MapStatus, Odometry
from shared.runtime.config import MapperConfig
from tests.unit.test_mapper import feed, only, pose, scan

SETTINGS = [{"method": "plane"}, {"method": "gicp"}, {"method": "gicp", "scan_to": "scan"}]


def states(mapper):
    pose_state, map_state = mapper.pose_snapshot(), mapper.map_snapshot()
    return decode(PoseState, encode(pose_state)), decode(MapState, encode(map_state))


def found(messages):
    return SE3.from_xyz_quat_xyzw(only(Odometry, messages).T_frame_child)


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda settings: "-".join(settings.values()))
def test_the_rest_of_a_run_is_as_without_the_death(settings):
    config = MapperConfig(**settings)
    whole, killed, again = Mapper(config), Mapper(config), Mapper(config)
    for mapper in (whole, killed):
        feed(mapper, [scan(k, pose(k)) for k in range(10)])
    (event,) = again.restore(*states(killed))
    assert event.text.startswith("restored at 0.90 s: goes on in its map of ")
    for k in range(10, 20):
        (expected,), (messages,) = (feed(mapper, [scan(k, pose(k))]) for mapper in (whole, again))
        step = found(expected).inv() @ found(messages)
        assert np.linalg.norm(step.translation) < 0.001
        assert step.angle_rad < 0.001
        for kind in (Odometry, MapStatus):
            assert only(kind, messages).seq == only(kind, expected).seq == k
        assert only(MapStatus, messages).is_tracking


def test_a_map_that_is_a_little_older_does_as_well():
    killed, again = Mapper(MapperConfig()), Mapper(MapperConfig())
    feed(killed, [scan(k, pose(k)) for k in range(5)])
    known = killed.map_snapshot()
    feed(killed, [scan(k, pose(k)) for k in range(5, 10)])
    (event,) = again.restore(killed.pose_snapshot(), known)
    assert event.text.endswith("kept 0.5 s before")
    (messages,) = feed(again, [scan(10, pose(10))])
    assert np.linalg.norm((pose(10).inv() @ found(messages)).translation) < 0.005


def test_planes_keep_their_numbers_and_moments():
    killed, again = PlaneMatcher(MapperConfig()), PlaneMatcher(MapperConfig())
    killed.start(scan(0).points_m, SE3.identity())
    again.restore(killed.snapshot())
    for name in ("ids", "planes", "num_points", "moments", "origins_m"):
        np.testing.assert_array_equal(getattr(again.patches, name), getattr(killed.patches, name))
    assert again.snapshot() == killed.snapshot() or sorted(again.snapshot().planes.narrow.keys) == sorted(
        killed.snapshot().planes.narrow.keys
    )


def test_before_there_is_a_map_nothing_is_kept():
    mapper = Mapper(MapperConfig())
    assert mapper.pose_snapshot() is mapper.map_snapshot() is None
    feed(mapper, [scan(0, points=np.empty((0, 3)))])
    assert mapper.pose_snapshot() is None


def test_a_map_of_another_kind_is_refused_and_a_new_one_begins():
    killed, again = Mapper(MapperConfig(method="gicp")), Mapper(MapperConfig())
    feed(killed, [scan(0)])
    with pytest.raises(ValueError, match="is no map of planes"):
        again.restore(*states(killed))
    (messages,) = feed(again, [scan(1)])
    assert only(MapStatus, messages).is_tracking
    assert np.array_equal(found(messages).matrix, np.eye(4))


@pytest.mark.parametrize(
    "wrong",
    [
        {"keys": np.array([1, 1])},
        {"counts": np.zeros(2)},
    ],
)
def test_voxels_that_cannot_be_are_refused(wrong):
    from services.mapper.state import VoxelsState
    from services.mapper.voxel_map import VoxelMap

    plain = {"keys": np.array([1, 2]), "sums_m": np.ones((2, 3)), "counts": np.ones(2)}
    with pytest.raises(ValueError, match="voxel"):
        VoxelMap(0.05, 100).restore(VoxelsState(**(plain | wrong)))


def test_a_table_that_points_beyond_its_patches_is_refused():
    from dataclasses import replace

    killed = PlaneMatcher(MapperConfig())
    killed.start(scan(0).points_m, SE3.identity())
    state = killed.snapshot()
    lists = state.planes.narrow.lists.copy()
    lists[0] = 2 * len(state.planes.planes)
    wrong = replace(state, planes=replace(state.planes, narrow=replace(state.planes.narrow, lists=lists)))
    with pytest.raises(ValueError, match="does not fit"):
        PlaneMatcher(MapperConfig()).restore(wrong)


def test_events_of_the_first_scan_are_not_said_again():
    killed, again = Mapper(MapperConfig()), Mapper(MapperConfig())
    feed(killed, [scan(k, pose(k)) for k in range(3)])
    again.restore(*states(killed))
    (messages,) = feed(again, [scan(3, pose(3))])
    assert not [each for each in messages if isinstance(each, Event)]
