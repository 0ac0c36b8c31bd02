import dataclasses

import numpy as np
import pytest

from services.evaluator.evaluator import Evaluator
from services.evaluator.state import EvaluatorState
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.messaging.codec import decode, encode
from shared.messaging.messages import Event, Odometry, PointCloud, StructureDescription, TrackingMetrics, Transforms
from shared.runtime.config import EvaluatorConfig

T_WORLD_START = SE3.trans(1.0, 2.0, 10.0) @ SE3.rot("z", 0.3)
PERIOD_NS = 100_000_000


def truth(k):
    pose = T_WORLD_START @ SE3.trans(x_m=0.1 * k)
    edges = np.stack([pose.xyz_quat_xyzw, SE3.trans(z_m=0.5).xyz_quat_xyzw])
    return Transforms(
        stamp_ns=k * PERIOD_NS,
        seq=k,
        frame="world",
        parents=("world", "hip"),
        children=("hip", "lidar"),
        T_parent_child=edges,
    )


def estimate(k, error_m=0.0):
    pose = SE3.trans(x_m=0.1 * k, y_m=error_m).xyz_quat_xyzw
    return Odometry(stamp_ns=k * PERIOD_NS, seq=k, frame="map", child_frame="lidar_estimated", T_frame_child=pose)


def test_the_first_pair_lays_the_map_on_the_world():
    evaluator = Evaluator(EvaluatorConfig())
    assert evaluator.add_transforms(truth(0)) == []
    link, metrics = evaluator.add_odometry(estimate(0))
    assert isinstance(link, Transforms)
    assert (link.parents, link.children) == (("world",), ("map",))
    expected = (T_WORLD_START @ SE3.trans(z_m=0.5)).xyz_quat_xyzw
    np.testing.assert_allclose(link.T_parent_child[0], expected, atol=1e-12)
    assert isinstance(metrics, TrackingMetrics)
    assert metrics.ate_rmse_m == pytest.approx(0.0, abs=1e-9)


def test_truth_may_come_after_the_estimate_and_metrics_come_at_their_rate():
    evaluator = Evaluator(EvaluatorConfig(rate_hz=2.0))
    sent = []
    for k in range(11):
        evaluator.add_odometry(estimate(k, error_m=0.003 if k else 0.0))
        sent += [message for message in evaluator.add_transforms(truth(k)) if isinstance(message, TrackingMetrics)]
    assert [message.stamp_ns // PERIOD_NS for message in sent] == [0, 5, 10]
    assert sent[-1].num_poses == 11
    assert sent[-1].last_error_m == pytest.approx(0.003)
    assert sent[-1].ate_rmse_m == pytest.approx(0.003 * np.sqrt(10 / 11))


def test_what_finds_no_partner_is_forgotten():
    evaluator = Evaluator(EvaluatorConfig())
    for k in range(3000):
        assert evaluator.add_transforms(truth(k)) == []
    assert evaluator.add_odometry(estimate(10)) == []
    assert evaluator.add_odometry(estimate(2990)) != []


SLAB = '<robot name="s"><link name="world"><visual><geometry><box size="4 4 0.2"/></geometry></visual></link></robot>'


def cloud(points_m):
    return PointCloud(stamp_ns=0, seq=0, frame="map", points_m=points_m)


def paired(evaluator, k, error_m=0.0, seq=None):
    """What is said when truth and estimate of moment k have come."""
    said = evaluator.add_transforms(truth(k))
    odometry = estimate(k, error_m)
    return said + evaluator.add_odometry(odometry if seq is None else dataclasses.replace(odometry, seq=seq))


def test_drift_and_rotation_are_told():
    evaluator = Evaluator(EvaluatorConfig(rate_hz=10.0))
    paired(evaluator, 0)
    (metrics,) = paired(evaluator, 1, error_m=0.004)
    assert metrics.drift_m == pytest.approx(0.004)
    assert metrics.rpe_rmse_rad == pytest.approx(0.0, abs=1e-9)
    assert (metrics.map_accuracy_mean_m, metrics.num_map_points) == (None, None)


def test_the_map_is_compared_with_the_structure_in_the_world():
    evaluator = Evaluator(EvaluatorConfig(rate_hz=10.0))
    evaluator.set_structure(StructureDescription(stamp_ns=0, seq=0, frame="world", urdf=SLAB))
    x, y = np.random.default_rng(1).uniform(-1, 1, (2, 20_000))
    in_world = np.column_stack([x, y, np.full(20_000, 0.107)])
    T_world_map = T_WORLD_START @ SE3.trans(z_m=0.5)
    evaluator.add_cloud(cloud(T_world_map.inv().apply(in_world)))
    _, metrics = paired(evaluator, 0)
    assert metrics.num_map_points == 20_000
    assert metrics.map_accuracy_mean_m == pytest.approx(0.007, abs=1e-6)
    assert metrics.map_accuracy_p95_m == pytest.approx(0.007, abs=1e-6)


def test_a_map_without_points_has_no_accuracy():
    evaluator = Evaluator(EvaluatorConfig())
    evaluator.set_structure(StructureDescription(stamp_ns=0, seq=0, frame="world", urdf=SLAB))
    evaluator.add_cloud(cloud(np.empty((0, 3))))
    _, metrics = paired(evaluator, 0)
    assert (metrics.map_accuracy_mean_m, metrics.num_map_points) == (None, 0)


def test_a_structure_of_several_links_is_refused():
    urdf = SLAB.replace("</robot>", '<link name="b"/><joint name="j" type="fixed"><parent link="world"/>')
    urdf += '<child link="b"/></joint></robot>'
    with pytest.raises(InputFileError, match="must be one link"):
        Evaluator(EvaluatorConfig()).set_structure(StructureDescription(stamp_ns=0, seq=0, frame="world", urdf=urdf))


def test_when_stamps_go_back_a_new_comparison_begins():
    evaluator = Evaluator(EvaluatorConfig(rate_hz=10.0))
    for k in range(5, 10):
        paired(evaluator, k, error_m=0.01 * k)
    link, metrics = paired(evaluator, 0)
    assert (link.seq, metrics.num_poses) == (1, 1)
    np.testing.assert_allclose(link.T_parent_child[0], (T_WORLD_START @ SE3.trans(z_m=0.5)).xyz_quat_xyzw, atol=1e-12)
    assert metrics.ate_rmse_m == pytest.approx(0.0, abs=1e-12)


def test_truth_of_before_is_forgotten_when_stamps_go_back():
    evaluator = Evaluator(EvaluatorConfig())
    evaluator.add_transforms(truth(7))
    evaluator.add_transforms(truth(0))
    assert evaluator.add_odometry(estimate(7)) == []
    assert evaluator.add_transforms(truth(7)) != []


def test_when_the_mapper_was_started_again_a_new_comparison_begins_without_its_map():
    evaluator = Evaluator(EvaluatorConfig(rate_hz=10.0))
    evaluator.add_cloud(cloud(np.zeros((3, 3))))
    first = paired(evaluator, 0)[1]
    paired(evaluator, 1)
    assert paired(evaluator, 2, error_m=0.5)[0].num_poses == 3
    link, metrics = paired(evaluator, 3, error_m=0.5, seq=0)
    assert isinstance(link, Transforms)
    assert metrics.num_poses == 1
    assert (first.num_map_points, metrics.num_map_points) == (3, None)
    assert paired(evaluator, 4, error_m=0.5, seq=1)[0].drift_m == pytest.approx(0.0, abs=1e-12)


# ---- deaths


def fed(evaluator, numbers, error_m=0.0):
    """The metrics after each pair."""
    said = []
    for k in numbers:
        evaluator.add_transforms(truth(k))
        said += evaluator.add_odometry(estimate(k, error_m if k else 0.0))
    return [message for message in said if isinstance(message, TrackingMetrics)]


def test_an_evaluator_that_was_killed_goes_on_with_the_same_link_and_errors():
    whole, killed, again = (Evaluator(EvaluatorConfig(rate_hz=10.0)) for _ in range(3))
    fed(killed, range(10), error_m=0.003)
    assert fed(whole, range(10), error_m=0.003)
    link, event = again.restore(decode(EvaluatorState, encode(killed.snapshot())))
    np.testing.assert_allclose(link.T_parent_child[0], (T_WORLD_START @ SE3.trans(z_m=0.5)).xyz_quat_xyzw, atol=1e-12)
    assert (link.parents, link.children, link.seq) == (("world",), ("map",), 1)
    assert isinstance(event, Event)
    assert "goes on with the errors of 10 poses" in event.text
    for expected, metrics in zip(fed(whole, range(10, 15), 0.003), fed(again, range(10, 15), 0.003), strict=True):
        assert metrics == expected


def test_before_the_first_pair_there_is_nothing_to_keep():
    assert Evaluator(EvaluatorConfig()).snapshot() is None


def test_what_the_mapper_lost_is_not_hidden_by_a_new_link():
    killed, again = Evaluator(EvaluatorConfig()), Evaluator(EvaluatorConfig(rate_hz=10.0))
    fed(killed, range(10))
    again.restore(killed.snapshot())
    assert fed(again, [50], error_m=0.02)[0].last_error_m == pytest.approx(0.02)
