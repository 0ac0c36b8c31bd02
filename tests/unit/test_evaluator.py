import numpy as np
import pytest

from services.evaluator.evaluator import Evaluator
from shared.geometry import SE3
from shared.messaging.messages import Odometry, TrackingMetrics, Transforms
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
