"""A recording in the place of the LiDAR, by real processes: the mapper cannot tell."""

import sys
from pathlib import Path

import numpy as np
import pytest

from services.recorder.bag.recording import Recording
from shared.messaging.channels import EVENTS, LIDAR_POINTS, MAP_CLOUD, MAP_ODOMETRY, MAP_STATUS
from shared.messaging.messages import LidarScan, MapStatus, PointCloud
from tests.e2e.conftest import wait_for_services
from tests.support.bags import cloud, write_mcap
from tests.support.processes import ROOT, hyrecro_command, run, service_command, started, wait_until

pytestmark = pytest.mark.e2e

STAMP_NS = 1_650_408_693_802_616_001
PERIOD_NS = 100_000_000
NUM_SCANS = 20
STEP_M = 0.02
"""From scan to scan, along x."""


def room(position_m):
    """The walls of a room of 8 x 6 x 4 m around the origin, seen from `position_m`."""
    rng = np.random.default_rng(1)
    on_walls = rng.uniform(-1, 1, (6000, 3))
    axis = rng.integers(0, 3, 6000)
    on_walls[np.arange(6000), axis] = np.sign(on_walls[np.arange(6000), axis])
    return (on_walls * [4, 3, 2] - position_m).astype(np.float32)


@pytest.fixture(scope="module")
def mcap(tmp_path_factory):
    xyz = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    said = [
        ("/points", cloud(room([i * STEP_M, 0, 0]).view(xyz).reshape(-1), STAMP_NS + i * PERIOD_NS))
        for i in range(NUM_SCANS)
    ]
    return write_mcap(tmp_path_factory.mktemp("mcap") / "room.mcap", said)


def test_the_mapper_cannot_tell(mcap, tmp_path):
    with started(hyrecro_command("router"), tmp_path / "router") as router:
        wait_for_services(router, set())
        services = [
            started(service_command(f"services.{name}"), tmp_path / name, router.endpoint)
            for name in ("mapper", "recorder")
        ]
        with services[0] as mapper, services[1] as recorder:
            wait_for_services(router, {"mapper", "recorder"})
            played = run(
                sys.executable, "-m", "services.sensors", "--source", mcap, "--set", f"bus.endpoint={router.endpoint}"
            )
            assert played.returncode == 0, played.stderr
            with router.bus() as bus:
                wait_until(lambda: bus.ask(MAP_STATUS, MapStatus).scan_seq == NUM_SCANS - 1, "the last scan mapped")
                assert len(bus.ask(MAP_CLOUD, PointCloud).points_m) > 1000
            assert mapper.stop() == 130
            assert recorder.stop() == 130
    check_recording(Recording(next((tmp_path / "recorder").glob("2*/run.mcap"))))


def check_recording(recording):
    scans = [message for message in recording.messages(LIDAR_POINTS) if isinstance(message, LidarScan)]
    assert [scan.stamp_ns for scan in scans] == [STAMP_NS + i * PERIOD_NS for i in range(NUM_SCANS)]
    assert {scan.frame for scan in scans} == {"lidar"}
    np.testing.assert_array_equal(scans[3].points_m, room([3 * STEP_M, 0, 0]))
    assert all(status.is_tracking for status in recording.messages(MAP_STATUS))
    *_, last = recording.messages(MAP_ODOMETRY)
    np.testing.assert_allclose(last.T_frame_child[:3], [(NUM_SCANS - 1) * STEP_M, 0, 0], atol=0.005)
    texts = [event.text for event in recording.messages(EVENTS)]
    assert texts == [f"end of room.mcap: {NUM_SCANS} scans"]


def test_what_cannot_be_played_is_said_in_one_line(mcap, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(mcap.read_bytes()[:5])
    for source, said in (
        (Path("nowhere.pcap"), "nowhere.pcap: no such file"),
        (cut, "cut.mcap: not readable as a recording"),
    ):
        result = run(sys.executable, "-m", "services.sensors", "--source", source, cwd=ROOT)
        assert result.returncode == 2
        assert said in result.stderr
        assert len(result.stderr.splitlines()) == 1
    result = run(sys.executable, "-m", "services.sensors", "--sensor", "depth", "--source", mcap)
    assert result.returncode == 2
    assert "no topic of sensor_msgs/msg/Image; it has /points (sensor_msgs/msg/PointCloud2)" in result.stderr
