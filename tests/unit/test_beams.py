"""The beams' geometry and their tables as files."""

import json

import numpy as np
import pytest
from ruamel.yaml import YAML

from services.sensors.lidar.beam_files import read_beams
from services.sensors.lidar.beams import uniform_beams
from shared.errors import InputFileError
from shared.runtime.config import CONFIGS_DIR

MEASURED = CONFIGS_DIR / "sensors" / "beams" / "os1_128_measured.yaml"
UNIFORM = CONFIGS_DIR / "sensors" / "beams" / "os1_128_uniform.yaml"


def test_rings_go_from_top_to_bottom_in_equal_steps():
    beams = read_beams(UNIFORM, 512)
    assert beams.directions().shape == (512, 128, 3)
    np.testing.assert_allclose(np.linalg.norm(beams.directions(), axis=-1), 1.0, atol=1e-12)
    elevations_deg = np.rad2deg(np.arcsin(beams.directions()[7, :, 2]))
    assert (elevations_deg[0], elevations_deg[-1]) == pytest.approx((22.8, -22.8), abs=1e-6)
    np.testing.assert_allclose(np.diff(elevations_deg), -45.6 / 127, atol=1e-5)


def test_columns_start_at_x_and_turn_clockwise():
    beams = uniform_beams(1, 0.0, 0.0, 8)
    expected = [[1, 0, 0], [np.sqrt(0.5), -np.sqrt(0.5), 0], [0, -1, 0]]
    np.testing.assert_allclose(beams.directions()[:3, 0], expected, atol=1e-12)
    np.testing.assert_allclose(beams.origins_m(), 0.0)


def test_a_staggered_table_gives_the_points_of_the_makers_formula():
    beams = read_beams(MEASURED, 1024)
    table = YAML(typ="safe").load(MEASURED.read_text())
    n, range_m = table["origin_m"], 5.0
    encoder = 2 * np.pi * (1 - np.arange(1024) / 1024)[:, np.newaxis]
    azimuth, altitude = -np.deg2rad(table["azimuths_deg"]), np.deg2rad(table["elevations_deg"])
    x = (range_m - n) * np.cos(encoder + azimuth) * np.cos(altitude) + n * np.cos(encoder)
    y = (range_m - n) * np.sin(encoder + azimuth) * np.cos(altitude) + n * np.sin(encoder)
    z = np.broadcast_to((range_m - n) * np.sin(altitude), x.shape)
    points_m = beams.origins_m()[:, np.newaxis] + (range_m - n) * beams.directions()
    np.testing.assert_allclose(points_m, np.stack([-x, -y, z + 0.03618], axis=-1), atol=1e-12)


def ouster_metadata(in_sections):
    table = YAML(typ="safe").load(MEASURED.read_text())
    beams = {
        "beam_altitude_angles": table["elevations_deg"],
        "beam_azimuth_angles": table["azimuths_deg"],
        "lidar_origin_to_beam_origin_mm": 1000 * table["origin_m"],
    }
    extrinsics = {"lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1]}
    return {"beam_intrinsics": beams, "lidar_intrinsics": extrinsics} if in_sections else {**beams, **extrinsics}


@pytest.mark.parametrize("in_sections", [False, True])
def test_the_metadata_of_a_real_sensor_is_a_table_too(tmp_path, in_sections):
    path = tmp_path / "unit.json"
    path.write_text(json.dumps(ouster_metadata(in_sections)))
    np.testing.assert_allclose(read_beams(path, 512).directions(), read_beams(MEASURED, 512).directions(), atol=1e-12)
    np.testing.assert_allclose(read_beams(path, 512).origins_m(), read_beams(MEASURED, 512).origins_m(), atol=1e-12)


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("elevations_deg", list(range(127, 0, -1)), "elevations_deg: must be 128 numbers, are 127"),
        ("elevations_deg", list(range(128)), "must fall from top to bottom"),
        ("elevations_deg", [100 - i for i in range(128)], "within -90..90"),
        ("azimuths_deg", None, "azimuths_deg: must be 128 numbers"),
        ("azimuths_deg", ["x"] * 128, "azimuths_deg: must be 128 numbers"),
        ("azimuths_deg", [float("nan")] * 128, "azimuths_deg: must be finite"),
        ("origin_m", 3.0, r"origin_m: must be within 0..0.1, is 3"),
        ("sensor_lidar_xyz_m", [0, 0], "sensor_lidar_xyz_m: must be 3 numbers, are 2"),
    ],
)
def test_a_table_that_is_none_is_refused_by_key(tmp_path, key, value, expected):
    table = YAML(typ="safe").load(UNIFORM.read_text()) | {key: value}
    path = tmp_path / "beams.yaml"
    with path.open("w") as file:
        YAML(typ="safe").dump(table, file)
    with pytest.raises(InputFileError, match=f"beams.yaml: .*{expected}"):
        read_beams(path, 512)


@pytest.mark.parametrize(("name", "text"), [("b.yaml", "[1"), ("b.yaml", "- 1"), ("b.json", "{"), ("b.json", "[]")])
def test_a_file_that_is_no_table(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputFileError, match=name):
        read_beams(tmp_path / name, 512)
