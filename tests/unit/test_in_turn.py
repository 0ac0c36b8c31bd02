"""What the mapper is given follows from the data, not from what overtook what on the way."""

import itertools

import numpy as np
import pytest

from services.mapper.in_turn import InTurn
from shared.messaging.messages import DepthImage, Foot, Imu, JointState, LegState, LidarScan
from shared.runtime.config import MapperConfig

MS = 10**6


class Log:
    """In a mapper's place: what it was given, in its order."""

    def __init__(self):
        self.given = []

    def add(self, message, *_):
        self.given.append((type(message).__name__, message.stamp_ns // MS))
        return [message]

    add_joints = add_imu = add_leg_state = add_scan = add_image = add


def at(ms, seq=0):
    return {"stamp_ns": ms * MS, "seq": seq, "frame": "lidar"}


def joints(ms):
    return JointState(**at(ms), q=np.zeros(8), dq=np.zeros(8))


def imu(ms):
    return Imu(**at(ms), angular_velocity_radps=np.zeros(3), linear_acceleration_mps2=np.zeros(3))


def legs(ms):
    return LegState(**at(ms), fixed_foot=Foot.A, T_world_foot=np.array([0, 0, 0, 0, 0, 0, 1.0]))


def scan(ms, lasts_ms=100):
    t_ns = np.array([0, lasts_ms * MS])
    return LidarScan(**at(ms), points_m=np.zeros((2, 3)), intensity=np.zeros(2), t_ns=t_ns, ring=np.zeros(2))


def image(ms):
    return DepthImage(**at(ms), height=1, width=1, depth_mm=np.zeros(1))


def given(*messages, prior="legs", finish=True):
    log = Log()
    in_turn = InTurn(log, MapperConfig(prior=prior))
    add = {
        JointState: in_turn.add_joints,
        Imu: in_turn.add_imu,
        LegState: in_turn.add_leg_state,
        LidarScan: lambda message: in_turn.add_scan(message, 0),
        DepthImage: lambda message: in_turn.add_image(message, 0),
    }
    for message in messages:
        add[type(message)](message)
    if finish:
        in_turn.finish()
    return [entry for entry in log.given if entry[0] not in ("JointState", "Imu")], log.given


def test_a_scan_waits_for_the_readings_of_its_time():
    _, all_of_it = given(joints(0), scan(0), joints(50), joints(100), joints(150))
    names = ["JointState", "JointState", "JointState", "LidarScan", "JointState"]
    assert [name for name, _ in all_of_it] == names


def test_every_order_of_arrival_gives_one_order():
    """Of what comes before the reading that ends the wait."""
    late = [scan(0), legs(60), scan(20, 70), image(95)]
    orders = {tuple(given(joints(0), *order, joints(100))[0]) for order in itertools.permutations(late)}
    assert orders == {(("LegState", 60), ("LidarScan", 20), ("DepthImage", 95), ("LidarScan", 0))}


def test_at_one_time_the_foot_is_known_first():
    assert given(joints(0), scan(0), legs(100), joints(100))[0] == [("LegState", 100), ("LidarScan", 0)]


@pytest.mark.parametrize("messages", [(scan(0),), (legs(0),), (joints(500), scan(0)), (joints(0), scan(300))])
def test_nothing_is_waited_for_that_is_there_or_never_comes(messages):
    assert len(given(*messages, finish=False)[0]) == 1


def test_readings_that_end_hold_nothing_for_long():
    taken = given(joints(0), scan(0), scan(100), finish=False)[0]
    assert taken == []
    assert len(given(joints(0), scan(0), scan(100), scan(200), finish=False)[0]) == 3


def test_the_end_of_all_takes_what_still_waits():
    assert given(joints(0), scan(0), finish=False)[0] == []
    assert given(joints(0), scan(0))[0] == [("LidarScan", 0)]


def test_with_the_imu_as_prior_it_is_waited_for_too():
    assert given(joints(0), imu(0), scan(0), joints(100), prior="imu", finish=False)[0] == []
    assert given(joints(0), imu(0), scan(0), joints(100), imu(100), prior="imu", finish=False)[0] != []
    assert given(joints(0), imu(0), scan(0), joints(100), prior="legs", finish=False)[0] != []


def test_time_that_goes_back_lets_go_of_what_waits():
    assert given(joints(900), scan(900), joints(0), finish=False)[0] == [("LidarScan", 900)]


def test_what_was_said_of_each_scan_is_noted():
    noted = []
    in_turn = InTurn(Log(), MapperConfig(), noted.append)
    for k in range(3):
        in_turn.add_scan(scan(100 * k), 0)
    assert [len(said) for said in noted] == [1, 1, 1]


@pytest.mark.parametrize("num_scans", [1, 9])
def test_a_mapper_that_goes_on_waits_for_its_joints(num_scans):
    log = Log()
    in_turn = InTurn(log, MapperConfig())
    in_turn.expect_joints()
    for k in range(num_scans):
        assert in_turn.add_scan(scan(100 * k), 0) == []
    in_turn.add_joints(joints(2000))
    assert [name for name, _ in log.given] == ["JointState"] + ["LidarScan"] * num_scans


def test_it_does_not_wait_for_joints_without_end():
    in_turn = InTurn(Log(), MapperConfig())
    in_turn.expect_joints()
    said = [len(in_turn.add_scan(scan(100 * k), 0)) for k in range(12)]
    assert said[:9] == [0] * 9
    assert sum(said) > 0
