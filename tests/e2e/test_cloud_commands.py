"""Clouds from a real bus: planes of the map as it is, scans saved by themselves and by a key press."""

import json
import os
import pty
import signal
import subprocess
import threading

import numpy as np
import pytest

from shared.cloud_files import read_cloud
from shared.messaging.bus import Bus
from shared.messaging.channels import LIDAR_POINTS, MAP_CLOUD
from shared.messaging.messages import LidarScan, PointCloud
from shared.messaging.router import open_router
from shared.runtime.config import BusConfig
from tests.support.processes import BIN, free_endpoint, run, wait_until

pytestmark = pytest.mark.e2e


@pytest.fixture(scope="module")
def endpoint():
    """A router; a map that is kept, and a scan every 20 ms."""
    address = free_endpoint()
    is_over = threading.Event()
    floor = np.random.default_rng(1).uniform(0, 1, (500, 3)) * [1, 1, 0]
    with open_router(address), Bus(BusConfig(endpoint=address)) as bus:
        bus.advertise(MAP_CLOUD)
        bus.publish(MAP_CLOUD, PointCloud(stamp_ns=0, seq=0, frame="map", points_m=floor))
        bus.advertise(LIDAR_POINTS)
        sender = threading.Thread(target=send_scans, args=(bus, is_over))
        sender.start()
        yield address
        is_over.set()
        sender.join()


def send_scans(bus, is_over):
    per_point = {"intensity": [1.0] * 3, "t_ns": [0, 1, 2], "ring": [0] * 3}
    seq = 0
    while not is_over.wait(0.02):
        scan = LidarScan(stamp_ns=seq, seq=seq, frame="lidar", points_m=np.full((3, 3), seq), **per_point)
        bus.publish(LIDAR_POINTS, scan)
        seq += 1


def cloud(endpoint, *words):
    return run("hyrecro", "cloud", *words, "--set", f"bus.endpoint={endpoint}")


def test_planes_of_the_live_map(endpoint):
    result = cloud(endpoint, "planes", "--live", "--json")
    assert result.returncode == 0, result.stderr
    assert [plane["inliers"] for plane in json.loads(result.stdout)["planes"]] == [500]


def test_scans_are_saved_by_themselves(endpoint, tmp_path):
    result = cloud(endpoint, "save", "--every", "0.1", "--num", "3", "--out", tmp_path)
    assert (result.returncode, result.stdout) == (0, f"3 clouds in {tmp_path}\n"), result.stderr
    seqs = [read_cloud(tmp_path / f"data{k}.pcd").points_m[0, 0] for k in range(3)]
    assert seqs == sorted(set(seqs))


def test_ctrl_c_ends_saving_with_a_count(endpoint, tmp_path):
    words = ["cloud", "save", "--every", "0", "--out", tmp_path, "--set", f"bus.endpoint={endpoint}"]
    with subprocess.Popen([BIN / "hyrecro", *words], stdout=subprocess.PIPE, text=True) as process:
        wait_until((tmp_path / "data1.pcd").exists, "two clouds")
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=30)
    assert process.returncode == 130
    assert out == f"{len(list(tmp_path.iterdir()))} clouds in {tmp_path}\n"


def test_enter_saves_one_cloud(endpoint, tmp_path):
    ours, theirs = pty.openpty()
    words = ["cloud", "save", "--num", "2", "--out", tmp_path, "--set", f"bus.endpoint={endpoint}"]
    with subprocess.Popen([BIN / "hyrecro", *words], stdin=theirs, stdout=subprocess.PIPE, text=True) as process:
        os.write(ours, b"\n")
        wait_until((tmp_path / "data0.pcd").exists, "the first cloud")
        assert not (tmp_path / "data1.pcd").exists()
        os.write(ours, b"\n")
        out, _ = process.communicate(timeout=30)
    os.close(ours)
    os.close(theirs)
    assert (process.returncode, out) == (0, f"2 clouds in {tmp_path}\n")


def test_silence_is_told(endpoint):
    result = cloud(endpoint, "planes", "--live", "--key", "depth/points")
    assert result.returncode == 1
    assert "no cloud came on hyrecro/depth/points within 5 s" in result.stderr
