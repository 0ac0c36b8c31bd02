"""The inertial unit against motions whose measurements are known in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from services.sensors.imu import InertialUnit
from shared.geometry import SE3
from shared.runtime.sensor_config import ImuConfig

PERIOD_NS = 10_000_000
SILENT = dict.fromkeys(ImuConfig.model_fields, 0.0)
G = 9.81
UP = np.array([0, 0, G])


def unit(rate_hz=100.0, seed=1, gravity_mps2=G, **errors):
    config = ImuConfig.model_validate({**SILENT, "rate_hz": rate_hz, **errors})
    return InertialUnit(config, "lidar", np.random.default_rng(seed), gravity_mps2)


def fed(inertial, T_world_sensor, stamps_ns):
    return [message for t in stamps_ns for message in inertial.add_pose(int(t), T_world_sensor(t * 1e-9))]


def every(period_ns, duration_s, start_s=0.0):
    return range(round(start_s * 1e9), round((start_s + duration_s) * 1e9) + 1, period_ns)


def columns(messages):
    gyro = np.array([message.angular_velocity_radps for message in messages])
    return gyro, np.array([message.linear_acceleration_mps2 for message in messages])


def still(_t):
    return SE3.identity()


@given(rpy=st.tuples(*[st.floats(-3, 3)] * 3), gravity_mps2=st.floats(0, 20))
@settings(max_examples=20)
def test_at_rest_it_reads_gravity_upwards_in_its_own_frame(rpy, gravity_mps2):
    T = SE3.from_rpy(rpy, (1.0, 2.0, 3.0))
    gyro, accel = columns(fed(unit(gravity_mps2=gravity_mps2), lambda _: T, every(PERIOD_NS, 0.1)))
    np.testing.assert_allclose(gyro, 0, atol=1e-12)
    np.testing.assert_allclose(accel, np.tile(T.rotation.T @ [0, 0, gravity_mps2], (len(accel), 1)), atol=1e-9)


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 400.0])
def test_constant_rotation_about_an_axis_beside_it(rate_hz):
    """On a circle: the rate about the axis, and rate^2 * radius towards it, plus gravity."""
    rate_radps, T_axis_sensor = 2.0, SE3.from_rpy((0.3, -0.2, 0.1), (0.5, 0.0, 0.2))

    def T(t):
        return SE3.rot("z", rate_radps * t) @ T_axis_sensor

    messages = fed(unit(rate_hz), T, every(PERIOD_NS, 0.5))
    gyro, accel = columns(messages)
    R = T_axis_sensor.rotation
    np.testing.assert_allclose(gyro, np.tile([0, 0, rate_radps] @ R, (len(gyro), 1)), atol=1e-9)
    expected = np.array([-(rate_radps**2) * 0.5, 0, G]) @ R
    np.testing.assert_allclose(accel, np.tile(expected, (len(accel), 1)), atol=2e-4)


@pytest.mark.parametrize("stamps", ["even", "uneven"])
def test_constant_acceleration_is_exact(stamps):
    acceleration, R = np.array([0.5, -1.0, 2.0]), SE3.from_rpy((0.1, 0.2, 0.3))

    def T(t):
        return SE3(R.rotation, np.array([1.0, 0, 0]) + 0.3 * t + 0.5 * acceleration * t**2)

    stamps_ns = np.array(every(PERIOD_NS, 0.5))
    if stamps == "uneven":
        stamps_ns = np.delete(stamps_ns, [3, 4, 10, 17, 18, 19, 40])
    gyro, accel = columns(fed(unit(400.0), T, stamps_ns))
    np.testing.assert_allclose(gyro, 0, atol=1e-9)
    np.testing.assert_allclose(accel, np.tile((acceleration + UP) @ R.rotation, (len(accel), 1)), atol=1e-8)


def test_a_swinging_rate_is_read_without_lag():
    """Turning by 0.5 sin(4 t) about x: the errors are of second order in the period, those of a lag of first."""
    messages = fed(unit(400.0), lambda t: SE3.rot("x", 0.5 * np.sin(4 * t)), every(PERIOD_NS, 1.0))
    t = np.array([message.stamp_ns for message in messages]) * 1e-9
    gyro, accel = columns(messages)
    np.testing.assert_allclose(gyro[:, 0], 2 * np.cos(4 * t), atol=2 * (4 * 0.01) ** 2)
    angle_rad = 0.5 * np.sin(4 * t)
    np.testing.assert_allclose(accel[:, 1:], G * np.column_stack([np.sin(angle_rad), np.cos(angle_rad)]), atol=2e-3)


def test_falling_it_reads_nothing():

    def T(t):
        return SE3.trans(z_m=-0.5 * G * t**2)

    _, accel = columns(fed(unit(), T, every(PERIOD_NS, 0.2)))
    np.testing.assert_allclose(accel, 0, atol=1e-8)


@pytest.mark.parametrize("rate_hz", [63.0, 100.0, 200.0, 250.0, 400.0])
@pytest.mark.parametrize("start_ns", [0, 3_000_000, 123_456_789])
@pytest.mark.parametrize("dropped", [[], [5, 6, 7, 20]])
def test_one_message_a_stamp(rate_hz, start_ns, dropped):
    stamps_ns = np.delete(np.arange(start_ns, start_ns + 500_000_000, PERIOD_NS), dropped)
    messages = fed(unit(rate_hz), still, stamps_ns)
    multiples = [round(k * 1e9 / rate_hz) for k in range(1000)]
    expected = [stamp for stamp in multiples if stamps_ns[1] <= stamp <= stamps_ns[-2]]
    assert [message.stamp_ns for message in messages] == expected
    assert [message.seq for message in messages] == list(range(len(expected)))
    assert {message.frame for message in messages} == {"lidar"}


def test_a_measurement_waits_for_one_more_pose():
    inertial = unit(200.0)
    sent = [
        [message.stamp_ns // 1_000_000 for message in inertial.add_pose(t, still(t))] for t in every(PERIOD_NS, 0.04)
    ]
    assert sent == [[], [], [10], [15, 20], [25, 30]]


@pytest.mark.parametrize("jump_ns", [150_000_000, -200_000_000, 0], ids=["gap", "restart", "reset"])
def test_after_a_jump_it_begins_anew(jump_ns):
    inertial = unit(100.0)
    before = fed(inertial, still, every(PERIOD_NS, 0.3))
    start_ns = 300_000_000 + jump_ns
    elsewhere = SE3.trans(x_m=5.0)
    after = fed(inertial, lambda _: elsewhere, range(start_ns, start_ns + 60_000_000, PERIOD_NS))
    assert [message.stamp_ns for message in after] == [start_ns + k * PERIOD_NS for k in (1, 2, 3, 4)]
    assert [message.seq for message in before + after] == list(range(len(before) + 4))
    np.testing.assert_allclose(columns(after)[1], np.tile(UP, (4, 1)), atol=1e-9)


def test_a_gap_of_a_tenth_of_a_second_is_interpolated():
    messages = fed(unit(100.0), still, [0, 10_000_000, 110_000_000, 120_000_000])
    assert [message.stamp_ns // PERIOD_NS for message in messages] == list(range(1, 12))


def test_a_rate_of_zero_is_silent():
    assert fed(unit(0.0), still, every(PERIOD_NS, 0.1)) == []


def test_the_same_seed_gives_the_same_measurements():
    errors = {"gyro_noise_radps_per_sqrt_hz": 0.01, "accel_walk_mps3_per_sqrt_hz": 0.1, "accel_bias_mps2": 0.2}
    one, same, other = (fed(unit(seed=seed, **errors), still, every(PERIOD_NS, 0.1)) for seed in (1, 1, 2))
    assert one == same
    assert one != other


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_white_noise_has_the_density_times_the_root_of_the_rate(rate_hz):
    """Sum of n squares over sigma^2 is chi squared: within 4 of its standard deviations, sqrt(2 n)."""
    noise = {"gyro_noise_radps_per_sqrt_hz": 0.002, "accel_noise_mps2_per_sqrt_hz": 0.03}
    gyro, accel = columns(fed(unit(rate_hz, **noise), still, every(PERIOD_NS, 800 / rate_hz)))
    for values, density in ((gyro, 0.002), (accel - UP, 0.03)):
        chi2 = np.sum((values / (density * np.sqrt(rate_hz))) ** 2)
        assert abs(chi2 - values.size) < 4 * np.sqrt(2 * values.size)
        neighbours = np.corrcoef(values[1:].ravel(), values[:-1].ravel())[0, 1]
        assert abs(neighbours) < 4 / np.sqrt(values.size)


def test_biases_walk_by_the_root_of_time():
    """Steps of the bias are independent, of the variance density^2 * period; it begins where it was drawn."""
    walk = {"gyro_walk_radps2_per_sqrt_hz": 0.5, "accel_walk_mps3_per_sqrt_hz": 0.3}
    gyro, accel = columns(fed(unit(400.0, **walk), still, every(PERIOD_NS, 2.0)))
    for values, density in ((gyro, 0.5), (accel - UP, 0.3)):
        np.testing.assert_allclose(values[0], 0, atol=1e-9)
        for span in (1, 50):
            increments = values[span::span] - values[:-span:span]
            chi2 = np.sum(increments**2) / (density**2 * span / 400.0)
            assert abs(chi2 - increments.size) < 4 * np.sqrt(2 * increments.size)


def test_the_first_bias_is_drawn_once_a_unit():
    firsts = [
        columns(fed(unit(seed=seed, gyro_bias_radps=0.1), still, every(PERIOD_NS, 0.05)))[0] for seed in range(60)
    ]
    assert all((gyro == gyro[0]).all() for gyro in firsts)
    drawn = np.array([gyro[0] for gyro in firsts])
    assert abs(np.sum((drawn / 0.1) ** 2) - drawn.size) < 4 * np.sqrt(2 * drawn.size)
