"""Recordings over a real bus again, and the `hyrecro bag` commands on a recording of a real pipeline."""

import json
import signal
from collections import Counter

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from services.recorder.bag.recorded import RecordingReader
from services.recorder.ros.schemas import typestore
from shared.cloud_files import read_cloud, scan_files
from shared.messaging.channels import (
    CLOCK,
    JOINTS_STATE,
    LIDAR_POINTS,
    MAP_CLOUD,
    MAP_ODOMETRY,
    MAP_STATUS,
    REPLAY_CONTROL,
    ROBOT_DESCRIPTION,
    TF,
)
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import Clock, ReplayAction, ReplayControl
from tests.e2e.conftest import ALL_SERVICES, wait_for_services
from tests.support.processes import hyrecro_command, run, service_command, started, wait_until

pytestmark = pytest.mark.e2e

MAX_DIFFERENCE_M = 1e-6
SOME = ["-0.3", "0", "0.3", "0", "0", "0.3", "0", "-0.3"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Some seconds of a robot that moves, mapped live."""
    with started(hyrecro_command("up"), tmp_path_factory.mktemp("live")) as running:
        wait_for_services(running, ALL_SERVICES)
        assert running.hyrecro("robot", "joints", *SOME).returncode == 0
        wait_until(lambda: running.state()["stamp_s"] > 6, "six seconds of simulated time")
        assert running.stop(signal.SIGINT) == 130
    return running.directory / "latest" / "run.mcap"


@pytest.fixture
def bus(tmp_path):
    with started(hyrecro_command("router"), tmp_path) as running:
        wait_for_services(running, set())
        yield running


def read(path, *channels):
    return [recorded.message() for recorded in RecordingReader(path, channels.__contains__).messages()]


@pytest.mark.parametrize("speed", [1, 4])
def test_all_messages_arrive_in_their_order_at_any_pace(recording, bus, speed):
    wanted = (CLOCK, TF, JOINTS_STATE, ROBOT_DESCRIPTION, LIDAR_POINTS)
    sent = {channel.key_expr: len(read(recording, channel)) for channel in wanted}
    inbox = Inbox(max_bytes=2**30)
    with bus.bus() as session:
        for channel in wanted:
            session.subscribe(channel, inbox)
        patterns = [word for channel in wanted for word in ("--channels", channel.key)]
        replay = bus.hyrecro("replay", recording, "--speed", str(speed), "--json", *patterns)
        assert replay.returncode == 0, replay.stderr
        figures = json.loads(replay.stdout)
        parcels = []
        while (parcel := inbox.take(0.5)) is not None:
            parcels.append(parcel)
    assert Counter(parcel.key for parcel in parcels if not parcel.is_replay) == sent
    assert figures["messages"] == sum(sent.values())
    clocks = [decode(Clock, parcel.payload) for parcel in parcels if parcel.key == CLOCK.key_expr]
    assert [clock.stamp_ns for clock in clocks] == [clock.stamp_ns for clock in read(recording, CLOCK)]
    assert {clock.real_time_factor for clock in clocks} == {speed}


def test_in_lockstep_a_new_mapper_finds_the_same_map(recording, bus, tmp_path):
    settings = ["--set", f"bus.endpoint={bus.endpoint}"]
    with (
        started(service_command("services.mapper", *settings), tmp_path / "mapper", bus.endpoint),
        started(service_command("services.recorder"), tmp_path / "again", bus.endpoint) as recorder,
    ):
        wait_for_services(bus, {"mapper", "recorder"})
        replay = bus.hyrecro("replay", recording, "--lockstep", "--json")
        assert replay.returncode == 0, replay.stderr
        assert recorder.stop(signal.SIGTERM) in (0, 3)
    again = tmp_path / "again" / "latest" / "run.mcap"
    live, new = (
        {message.stamp_ns: message.T_frame_child for message in read(path, MAP_ODOMETRY)} for path in (recording, again)
    )
    assert live.keys() == new.keys()
    assert len(live) > 20
    assert max(np.abs(live[stamp_ns] - new[stamp_ns]).max() for stamp_ns in live) <= MAX_DIFFERENCE_M
    clouds = [read(path, MAP_CLOUD)[-1].points_m for path in (recording, again)]
    assert clouds[0].shape == clouds[1].shape
    assert np.abs(clouds[0] - clouds[1]).max() <= MAX_DIFFERENCE_M
    used = {status.scan_seq for status in read(recording, MAP_STATUS)}
    assert {scan.seq for scan in read(again, LIDAR_POINTS)} == used


def test_a_publisher_that_lives_is_not_doubled(recording, bus, tmp_path):
    with started(service_command("services.mapper"), tmp_path / "mapper", bus.endpoint):
        wait_for_services(bus, {"mapper"})
        refused = bus.hyrecro("replay", recording, "--channels", "map/odometry")
        assert refused.returncode == 1
        assert "map/odometry: published by another process now" in refused.stderr
        renamed = bus.hyrecro(
            "replay", recording, "--channels", "map/odometry", "--rename", "map=live", "--speed", "50"
        )
        assert renamed.returncode == 0


def test_pause_and_resume_over_the_bus_and_a_late_joiner(recording, bus, tmp_path):
    with started(hyrecro_command("replay", recording, "--paused", "--start", "2"), tmp_path / "r", bus.endpoint) as it:
        wait_for_services(bus, {"replay"})
        with bus.bus() as session:
            clock = wait_until(lambda: session.ask(CLOCK, Clock), "the clock at the place that was sought")
            assert clock.stamp_ns < 2.2e9
            assert session.ask(ROBOT_DESCRIPTION, ROBOT_DESCRIPTION.message) is not None
            session.command(REPLAY_CONTROL, ReplayControl(speed=50.0, action=ReplayAction.RESUME))
        assert it.process.wait(30) == 0


def test_the_bag_commands_on_a_damaged_recording(recording, tmp_path):
    whole = json.loads(run("hyrecro", "bag", "info", recording, "--json").stdout)
    assert whole["has_index"]
    content = recording.read_bytes()
    damaged, out = tmp_path / "damaged.mcap", tmp_path / "out.mcap"
    damaged.write_bytes(content[: len(content) * 2 // 3])
    info = run("hyrecro", "bag", "info", damaged)
    assert info.returncode == 3
    assert "INCOMPLETE" in info.stdout
    recovered = run("hyrecro", "bag", "recover", damaged, out, "--json")
    assert recovered.returncode == 3, recovered.stderr
    assert 0 < json.loads(recovered.stdout)["messages"] < whole["messages"]
    verified = json.loads(run("hyrecro", "bag", "verify", out, "--json").stdout)
    assert sum(topic["num_unreadable"] for topic in verified["topics"]) == 0
    assert run("rerun", "mcap", "check", out).returncode == 0
    assert run("hyrecro", "bag", "recover", damaged, out).returncode == 1


def test_verify_decodes_all_of_it(recording):
    figures = json.loads(run("hyrecro", "bag", "verify", recording, "--json").stdout)
    info = json.loads(run("hyrecro", "bag", "info", recording, "--json").stdout)
    assert sum(topic["num_messages"] for topic in figures["topics"]) == info["messages"]
    assert sum(topic["num_unreadable"] for topic in figures["topics"]) == 0


def test_rosbags_reads_the_rosbag2_folder(recording, tmp_path):
    converted = run("hyrecro", "bag", "convert", recording, tmp_path / "bag", "--json")
    assert converted.returncode == 0, converted.stderr
    with AnyReader([tmp_path / "bag"], default_typestore=typestore()) as reader:
        counts = Counter()
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            counts[connection.topic] += 1
    assert counts.total() == json.loads(converted.stdout)["written"]
    assert counts["/lidar/points"] == len(read(recording, LIDAR_POINTS))


@pytest.mark.parametrize(("suffix", "tolerance_m"), [("pcd", 0), ("ply", 0), ("las", 1e-5)])
def test_scans_become_clouds(recording, tmp_path, suffix, tolerance_m):
    converted = run("hyrecro", "bag", "convert", recording, tmp_path / "scans", "--to", suffix)
    assert converted.returncode == 0, converted.stderr
    scans = read(recording, LIDAR_POINTS)
    assert len(list((tmp_path / "scans").iterdir())) == len(scans)
    cloud = read_cloud(tmp_path / "scans" / f"data3.{suffix}")
    np.testing.assert_allclose(cloud.points_m, scans[3].points_m, atol=tolerance_m, rtol=0)
    if suffix == "pcd":
        np.testing.assert_array_equal(cloud.t_ns, scans[3].t_ns)
        assert len(scan_files(tmp_path / "scans").paths) == len(scans)


def test_the_last_map_and_depth_images_become_clouds(recording, tmp_path):
    assert (
        run("hyrecro", "bag", "convert", recording, tmp_path / "m", "--to", "ply", "--channel", "map/cloud").returncode
        == 0
    )
    points_m = read_cloud(tmp_path / "m" / "data0.ply").points_m
    np.testing.assert_array_equal(points_m, read(recording, MAP_CLOUD)[-1].points_m)
    assert (
        run(
            "hyrecro", "bag", "convert", recording, tmp_path / "d", "--to", "pcd", "--channel", "depth/points"
        ).returncode
        == 0
    )
    assert len(read_cloud(tmp_path / "d" / "data0.pcd").points_m) > 1000
    wrong = run("hyrecro", "bag", "convert", recording, tmp_path / "x", "--to", "pcd", "--channel", "tf")
    assert wrong.returncode == 1
    assert "carries no clouds" in wrong.stderr
