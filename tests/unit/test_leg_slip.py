"""A slip is told where legs and scans disagree."""

from services.mapper.slip import SlipWatch
from shared.geometry import SE3

MS = 1_000_000


class StraightLegs:
    """Legs that walk along x at 0.1 m/s, whatever happens."""

    def step(self, start_ns, end_ns):
        return SE3.trans(0.1e-9 * (end_ns - start_ns))


class NoLegs:
    def step(self, start_ns, end_ns):
        return None


def found(xs_m, legs, angle_rad=0.0):
    watch = SlipWatch(max_distance_m=0.01, max_angle_rad=0.03)
    results = []
    for k, x_m in enumerate(xs_m):
        pose = SE3.trans(x_m) @ SE3.rot("z", angle_rad * k)
        result = watch.compare(k * 100 * MS, pose, legs)
        results.append((result, result is not None and watch.is_slip(result)))
    return results


def test_legs_that_agree_do_not_slip():
    results = found([0.01 * k for k in range(30)], StraightLegs())
    assert results[0] == (None, False)
    assert all(result.distance_m < 1e-9 and not is_slip for result, is_slip in results[1:])


def test_a_jump_is_told_once():
    results = found([0.01 * k + (0.015 if k >= 20 else 0.0) for k in range(40)], StraightLegs())
    assert [k for k, (_, is_slip) in enumerate(results) if is_slip] == [20]
    assert abs(results[20][0].distance_m - 0.015) < 1e-9


def test_a_slow_slide_adds_up_over_a_second():
    results = found([0.0115 * k for k in range(10)], StraightLegs())
    assert [k for k, (_, is_slip) in enumerate(results) if is_slip] == [7]


def test_a_turn_is_a_slip_too():
    results = found([0.0] * 5, StraightLegs(), angle_rad=0.02)
    assert results[2][1]


def test_without_legs_there_is_nothing_to_compare():
    assert found([0.0, 0.1], NoLegs()) == [(None, False), (None, False)]


def test_after_a_loss_the_way_begins_anew():
    watch, legs = SlipWatch(0.01, 0.03), StraightLegs()
    watch.compare(0, SE3.identity(), legs)
    watch.forget()
    assert watch.compare(100 * MS, SE3.trans(5.0), legs) is None
    assert watch.compare(200 * MS, SE3.trans(5.01), legs).distance_m < 1e-9
