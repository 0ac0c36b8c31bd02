"""Whoever invents keys, names and times makes nothing grow without end."""

import numpy as np
import pytest

from cli.top import Top
from services.mapper.in_turn import InTurn
from services.mapper.postures import Postures
from services.mapper.priors.inertial import Inertial
from services.recorder.records import to_record
from services.recorder.rotation import FileSeries
from services.recorder.run_writer import RECORD_BYTES, RunWriter
from services.teleop.teleop import Teleop
from services.viewer.scene import Scene
from shared.errors import MessageError
from shared.messaging import messages as m
from shared.messaging.channels import CLOCK, EVENTS, HEALTH, TF
from shared.messaging.fields import MAX_NAME_CHARS
from shared.messaging.inbox import MAX_KEYS, OTHER_KEYS, PARCEL_BYTES, Inbox, Parcel
from shared.messaging.values import MAX_SERVICES
from shared.runtime.config import MapperConfig, RecorderConfig, TeleopConfig
from shared.runtime.health import Traffic

FEW = 50
IDENTITY = np.array([0, 0, 0, 0, 0, 0, 1.0])


def at(stamp_ns):
    return {"stamp_ns": stamp_ns, "seq": 0, "frame": "world"}


def health(service):
    return m.Health(**at(0), service=service, uptime_s=1.0, rss_bytes=1, busy_ratio=0.0, channels=())


def num_kept(keeper):
    return max(len(kept) for kept in vars(keeper).values() if hasattr(kept, "__len__"))


# ---- keys


@pytest.mark.parametrize("channel", [HEALTH, HEALTH.every()])
def test_invented_keys_are_one_key(channel):
    inbox, traffic = Inbox(), Traffic()
    for number in range(MAX_KEYS + FEW):
        key = f"hyrecro/health/{number}"
        assert inbox.put(Parcel(channel, key, b"", None, 0))
        traffic.refused(inbox.take(0.0).key)
    counts = {count.key: count for count in traffic.snapshot(inbox.num_dropped, {}, inbox.num_waiting())}
    assert len(counts) == MAX_KEYS + 1
    assert counts[OTHER_KEYS].num_refused == FEW
    assert num_kept(inbox) <= MAX_KEYS + 1


def test_what_is_dropped_of_invented_keys_is_counted():
    inbox = Inbox()
    for number in range(MAX_KEYS + FEW):
        inbox.put(Parcel(HEALTH, f"hyrecro/health/{number}", b"", None, 0))
    assert inbox.num_dropped == {OTHER_KEYS: FEW - 2}, "the newest two of them all wait"
    assert len(inbox.num_waiting()) == MAX_KEYS + 1


def test_a_key_longer_than_a_name_can_be_told_in_a_heartbeat():
    inbox = Inbox()
    inbox.put(Parcel(HEALTH, "hyrecro/health/" + "x" * MAX_NAME_CHARS, b"", None, 0))
    assert m.ChannelCount(key=inbox.take(0.0).key).key == OTHER_KEYS


def test_parcels_without_payload_fill_an_inbox_too():
    inbox = Inbox(max_bytes=3 * PARCEL_BYTES)
    assert [inbox.put(Parcel(EVENTS, EVENTS.key_expr, b"", None, 0)) for _ in range(4)] == [True, True, True, False]


def test_small_records_fill_the_queue_before_the_disk_too(tmp_path):
    series = FileSeries(tmp_path, [], {}, RecorderConfig(min_free_mib=0), {})
    writer = RunWriter(series, max_queue_bytes=RECORD_BYTES, chunk_period_s=0.5)
    writer.put(to_record(CLOCK, m.Clock(**at(0)), 0, number=0))
    assert writer.close(10.0)
    assert series.progress() == {"clock": (0, 1)}


# ---- names


@pytest.mark.parametrize(
    "build",
    [
        health,
        lambda name: m.Event(**at(0), source=name, severity=m.Severity.INFO, text=""),
        lambda name: m.Clock(**(at(0) | {"frame": name})),
        lambda name: m.ChannelCount(key=name),
        lambda name: m.JointTarget(q=np.zeros(1), names=(name,)),
    ],
)
def test_a_name_has_an_end(build):
    build("x" * MAX_NAME_CHARS)
    with pytest.raises(MessageError, match=f"has 256 characters, at most {MAX_NAME_CHARS} are allowed"):
        build("x" * (MAX_NAME_CHARS + 1))


def test_the_page_hears_so_many_services():
    teleop = Teleop(TeleopConfig(), np.ones(8), {}, [])
    for number in range(MAX_SERVICES + FEW):
        teleop.add_health(health(f"s{number}"))
    teleop.add_health(health("s0"))
    assert len(teleop.heartbeat_ages()) == MAX_SERVICES


def test_top_shows_so_many_services():
    top = Top()
    for number in range(MAX_SERVICES + FEW):
        top.add(health(f"s{number}"), 0.0)
    assert len(top.services(0.0)) == MAX_SERVICES


def test_the_viewer_remembers_so_many_frames():
    scene, num_frames = Scene(), 3000
    for number in range(6):
        children = tuple(f"{number}_{child}" for child in range(num_frames))
        poses = np.tile(IDENTITY, (num_frames, 1))
        list(
            scene.draw(
                TF, m.Transforms(**at(0), parents=("world",) * num_frames, children=children, T_parent_child=poses)
            )
        )
    assert num_kept(scene) < 5 * num_frames


# ---- times


class Nobody:
    """In a mapper's place."""

    def add(self, _message):
        return []

    add_joints = add_leg_state = add


def test_what_is_of_a_time_that_does_not_come_waits_in_a_queue_that_ends():
    in_turn = InTurn(Nobody(), MapperConfig())
    in_turn.add_joints(m.JointState(**at(0), q=np.zeros(8), dq=np.zeros(8)))
    for number in range(1500):
        in_turn.add_leg_state(m.LegState(**at(10**15 + number), fixed_foot=m.Foot.A, T_world_foot=IDENTITY))
    assert num_kept(in_turn) <= 1000


def test_readings_a_nanosecond_apart_are_not_all_kept():
    inertial, zero = Inertial(), np.zeros(3)
    for stamp_ns in range(30_000):
        inertial.add_imu(m.Imu(**at(stamp_ns), angular_velocity_radps=zero, linear_acceleration_mps2=zero))
    assert num_kept(inertial) <= 10_001
    postures, joints = Postures(), m.JointState(**at(0), q=np.zeros(8), dq=np.zeros(8))
    for stamp_ns in range(110_000):
        object.__setattr__(joints, "stamp_ns", stamp_ns)
        postures.add(joints)
    assert num_kept(postures) <= 100_001
