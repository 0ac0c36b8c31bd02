"""What the benchmark over two hosts says of a cut, from what its listeners heard."""

import pytest

from bench.hosts.line_scoring import Cut, _after_cut, _flow
from bench.hosts.listener import Heard

CUT = Cut(began_ns=10 * 10**9, ended_ns=20 * 10**9)


def heard(key, seq, at_s, *, is_asked=False, q=()):
    return Heard(key, "", seq, round(at_s * 1e9), is_asked, q)


def joints(seq, at_s, angle):
    return heard("joints/state", seq, at_s, q=(angle,) * 8)


def test_a_flow_is_back_with_the_first_message_that_was_said_after_the_cut():
    robot = [heard("tf", 1, 9.9), heard("tf", 2, 15.0), heard("tf", 3, 21.0)]
    base = [heard("tf", 1, 20.5), heard("tf", 2, 20.6), heard("tf", 3, 21.5)]
    after = _after_cut(CUT, robot, base)
    assert after["flows_s"] == {"tf": 1.5}


def test_what_is_kept_is_back_with_the_answer_to_a_question():
    base = [heard("leg/state", 1, 9.0, is_asked=True), heard("leg/state", 5, 22.0, is_asked=True)]
    assert _after_cut(CUT, [], base)["kept_s"] == {"leg/state": 2.0}


@pytest.mark.parametrize(("last_s", "went_on_s"), [(23.0, 3.0), (19.0, None)])
def test_when_the_robot_stood_and_went_on(last_s, went_on_s):
    robot = [joints(0, 9.5, 0.1), joints(1, 10.2, 0.2), joints(2, 12.0, 0.2), joints(3, 18.0, 0.2)]
    robot.append(joints(4, last_s, 0.3))
    after = _after_cut(CUT, robot, [])
    assert after["stood_after_s"] == (0.2 if went_on_s else 9.0)
    assert after["went_on_s"] == went_on_s


def test_late_is_from_one_host_to_the_other():
    robot = [heard("tf", seq, seq) for seq in range(4)]
    base = [heard("tf", 0, 0.1), heard("tf", 3, 3.3)]
    flow = _flow("tf", robot, base, seconds=2.0)
    assert (flow.robot_hz, flow.base_hz, flow.late_p50_ms, flow.late_max_ms) == (2.0, 1.0, 200.0, 300.0)
