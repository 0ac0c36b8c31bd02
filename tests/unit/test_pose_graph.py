import dataclasses

import numpy as np
import pytest

from services.mapper.pose_graph import Edge, optimised
from shared.geometry import SE3


def around(num=12):
    """Poses around a circle of 2 m, the last one where the first one is."""
    return [SE3.rot("z", 2 * np.pi * k / num) @ SE3.trans(x_m=2.0) @ SE3.rot("x", 0.1 * k) for k in range(num + 1)]


def edge(poses, first, second, *, is_sure=True, error=None):
    T = poses[first].inv() @ poses[second] @ (error or SE3.identity())
    return Edge(first, second, T, 0.01, 0.005, is_sure)


def steps(poses, error=None):
    return [edge(poses, k, k + 1, error=error) for k in range(len(poses) - 1)]


def chained(edges):
    poses = [around()[0]]
    for step in edges:
        poses.append(poses[-1] @ step.T_first_second)
    return poses


def rms_m(poses, true):
    return np.sqrt(np.mean([np.sum((a.translation - b.translation) ** 2) for a, b in zip(poses, true, strict=True)]))


def test_consistent_edges_leave_poses_alone():
    true = around()
    graph = optimised(true, steps(true))
    assert rms_m(graph.T_map_pose, true) < 1e-9


def test_poses_are_found_from_edges_that_agree():
    true = around()
    rng = np.random.default_rng(1)
    wrong = [true[0], *(T @ SE3.exp(0.1 * rng.standard_normal(6)) for T in true[1:])]
    graph = optimised(wrong, [*steps(true), edge(true, 0, 6), edge(true, 3, 12)])
    for found, expected in zip(graph.T_map_pose, true, strict=True):
        np.testing.assert_allclose(found.matrix, expected.matrix, atol=1e-6)


def test_an_error_is_shared_out_by_the_variances():
    still = [SE3.identity()] * 3
    first = edge(still, 0, 1, error=SE3.trans(x_m=0.03))
    second = dataclasses.replace(edge(still, 1, 2), sigma_m=0.02)
    last = edge(still, 0, 2)
    graph = optimised(still, [first, second, last])
    # Of the 3 cm, the edges take shares of 1 : 4 : 1.
    assert graph.T_map_pose[1].translation[0] == pytest.approx(0.025, abs=1e-6)
    assert graph.T_map_pose[2].translation[0] == pytest.approx(0.005, abs=1e-6)


def test_a_loop_takes_most_of_the_drift_out():
    true = around()
    edges = steps(true, error=SE3.exp([0.005, 0, 0, 0, 0, 0.008]))
    drifted = chained(edges)
    graph = optimised(drifted, [*edges, edge(true, 0, 12, is_sure=False)])
    assert rms_m(drifted, true) > 0.1
    assert rms_m(graph.T_map_pose, true) < 0.25 * rms_m(drifted, true)
    assert graph.weights[-1] > 0.8


def test_a_wrong_loop_loses_its_weight():
    true = around()
    edges = steps(true)
    good = [edge(true, 0, 12, is_sure=False), edge(true, 1, 12, is_sure=False)]
    wrong = edge(true, 2, 11, is_sure=False, error=SE3.trans(x_m=0.5))
    graph = optimised(true, [*edges, *good, wrong])
    assert graph.weights[-1] < 0.01
    assert (graph.weights[:-1] > 0.95).all()
    assert rms_m(graph.T_map_pose, true) < 0.002


def test_one_pose_is_its_own_answer():
    graph = optimised([SE3.trans(x_m=1.0)], [])
    np.testing.assert_allclose(graph.T_map_pose[0].translation, [1.0, 0, 0])
