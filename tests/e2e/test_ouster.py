"""Packets of an Ouster through ouster-sdk in its own environment, against the sensor's own formula."""

import json
import subprocess
from pathlib import Path

import numpy as np
import psutil
import pytest

from services.sensors.sources.ouster_pcap import DEFAULT_PYTHON, metadata_of, read_pcap
from shared.errors import InputFileError
from shared.messaging.messages import LidarScan

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.skipif(not DEFAULT_PYTHON.exists(), reason="make ouster: no ouster-sdk here"),
]

GENERATOR = Path(__file__).parents[1] / "support" / "ouster_packets.py"
FIRST_STAMP_NS = 1_650_408_693_802_616_001
NUM_COLUMNS = 1024
COLUMN_NS = 100_000
RANGE_M = 5.0


@pytest.fixture(scope="module")
def pcap(tmp_path_factory):
    path = tmp_path_factory.mktemp("ouster") / "made_up.pcap"
    subprocess.run([DEFAULT_PYTHON, GENERATOR, path, metadata_of(path), "3"], check=True, timeout=60)
    return path


def read(pcap, metadata=None):
    return list(read_pcap(pcap, metadata or metadata_of(pcap), DEFAULT_PYTHON, "the_frame"))


def formula(metadata, ring, column):
    """Where a beam ends in the sensor's frame. Source: Ouster sensor data format."""
    origin_m = metadata["lidar_origin_to_beam_origin_mm"] / 1000
    T_sensor_lidar = np.reshape(metadata["lidar_to_sensor_transform"], (4, 4))
    encoder = 2 * np.pi * (1 - column / NUM_COLUMNS)
    azimuth = encoder - np.deg2rad(metadata["beam_azimuth_angles"])[ring]
    altitude = np.deg2rad(metadata["beam_altitude_angles"])[ring]
    along_m = RANGE_M - origin_m
    x = along_m * np.cos(azimuth) * np.cos(altitude) + origin_m * np.cos(encoder)
    y = along_m * np.sin(azimuth) * np.cos(altitude) + origin_m * np.sin(encoder)
    points_lidar_m = np.stack([x, y, along_m * np.sin(altitude)], axis=1)
    return points_lidar_m @ T_sensor_lidar[:3, :3].T + T_sensor_lidar[:3, 3] / 1000


def flat(metadata):
    """The names in one map, wherever the version of the metadata has them."""
    inner = [value for value in metadata.values() if isinstance(value, dict)]
    return {key: value for part in [metadata, *inner] for key, value in part.items()}


def test_scans(pcap):
    metadata = flat(json.loads(metadata_of(pcap).read_text()))
    scans = read(pcap)
    assert [(type(scan), scan.seq, scan.frame) for scan in scans] == [(LidarScan, i, "the_frame") for i in range(3)]
    num_rings = len(metadata["beam_altitude_angles"])
    for i, (scan, first_column) in enumerate(zip(scans, (0, 0, NUM_COLUMNS // 2), strict=True)):
        assert scan.stamp_ns == FIRST_STAMP_NS + i * 100_000_000 + first_column * COLUMN_NS
        ring, column = np.divmod(np.arange((num_rings - 1) * (NUM_COLUMNS - first_column)), NUM_COLUMNS - first_column)
        np.testing.assert_array_equal(scan.ring, ring + 1)
        np.testing.assert_array_equal(scan.t_ns, column * COLUMN_NS)
        np.testing.assert_array_equal(scan.intensity, np.full(len(ring), 77))
        np.testing.assert_allclose(scan.points_m, formula(metadata, ring + 1, first_column + column), atol=1e-5)


def test_metadata_of_another_sensor(pcap, tmp_path):
    other = json.loads(metadata_of(pcap).read_text())
    text = json.dumps(other).replace("7502", "7602")
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(
        InputFileError, match=r"made_up.pcap: it has no packet of the sensor in .*other.json on port 7602"
    ):
        read(pcap, path)
    path.write_text("{")
    with pytest.raises(InputFileError, match=r"other.json is no metadata of an Ouster"):
        read(pcap, path)


def test_a_pcap_that_is_none(pcap, tmp_path):
    path = tmp_path / "run.pcap"
    path.write_bytes(b"\x00" * 1000)
    with pytest.raises(InputFileError, match=r"run.pcap: unknown file format"):
        read(path, metadata_of(pcap))


def test_a_reader_that_stops_early_ends_the_decoder(pcap):
    recording = read_pcap(pcap, metadata_of(pcap), DEFAULT_PYTHON, "lidar")
    next(recording)
    (decoder,) = (child for child in psutil.Process().children() if str(pcap) in child.cmdline())
    recording.close()
    assert not decoder.is_running()
