"""`hyrecro map` on a folder of clouds: what it writes, and what it says of clouds that cannot be used."""

import json
import re
import shutil
import sys

import numpy as np
import pytest

from cli import main as command_line
from services.evaluator.trajectory_error import compare_trajectories
from shared.cloud_files import read_cloud, write_cloud
from shared.trajectory_files import read_tum, write_tum
from tests.support.processes import run
from tests.support.scans import NUM_SCANS

KEYS = {
    "method", "scans", "total_ms", "ms_per_scan_p50", "ms_per_scan_p99", "fitness_mean", "map_points",
    "off_plane_points", "lost_scans", "degenerate_scans", "peak_rss_mb",
}  # fmt: skip


@pytest.fixture
def folder(recorded_scans, tmp_path, monkeypatch):
    """A copy that may be spoilt, in the working directory."""
    shutil.copytree(recorded_scans[0], tmp_path / "scans")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "scans"


@pytest.fixture
def hyrecro(monkeypatch, capsys):
    def run(*words):
        monkeypatch.setattr(sys, "argv", ["hyrecro", *map(str, words)])
        with pytest.raises(SystemExit) as caught:
            command_line.main()
        captured = capsys.readouterr()
        return caught.value.code, captured.out, captured.err

    return run


@pytest.mark.parametrize("method", ["plane", "gicp"])
def test_a_folder_is_mapped(hyrecro, folder, recorded_scans, method):
    outputs = ("--map", "m.pcd", "--trajectory", "t.tum", "--json")
    code, out, err = hyrecro("map", folder, "--method", method, *outputs)
    figures = json.loads(out)
    assert (code, err) == (0, "")
    assert figures.keys() >= KEYS
    assert (figures["method"], figures["scans"], figures["lost_scans"]) == (method, NUM_SCANS, 0)
    poses = read_tum(folder.parent / "t.tum")
    assert [stamp_ns for stamp_ns, _ in poses] == [k * 10**9 for k in range(NUM_SCANS)]
    np.testing.assert_array_equal(poses[0][1].matrix, np.eye(4))
    assert compare_trajectories([pose for _, pose in poses], recorded_scans[1]).ate_rmse_m < 0.002
    assert len(read_cloud(folder.parent / "m.pcd").points_m) == figures["map_points"] > 1000


def test_what_the_viewer_shows_can_go_to_a_file(hyrecro, folder):
    code, _, err = hyrecro("map", folder, "--rrd", "map.rrd")
    assert (code, err) == (0, "")
    printed = run("rerun", "rrd", "print", folder.parent / "map.rrd")
    entities = set(re.findall(r"/[a-z_/]+", printed.stdout))
    assert entities >= {"/lidar/points", "/map/cloud", "/map/planes", "/map/odometry", "/map/status/score"}


def test_a_summary_is_for_people(hyrecro, folder):
    code, out, _ = hyrecro("map", folder, "--num", 3)
    assert code == 0
    assert "3 scans by plane" in out


def test_settings_can_be_given_by_options(hyrecro, folder):
    options = ("--num", 2, "--voxel", 0.2, "--range", 5, "--crop=-3,3,-3,3,-1,1", "--scan-to", "scan")
    code, out, _ = hyrecro("map", folder, *options, "--map", "m.pcd", "--json")
    points_m = read_cloud(folder.parent / "m.pcd").points_m
    assert (code, json.loads(out)["scans"]) == (0, 2)
    assert np.linalg.norm(points_m, axis=1).max() < 5.1
    assert (np.abs(points_m).max(axis=0) < [3.1, 3.1, 1.1]).all()


def test_a_prior_is_used_for_its_steps(hyrecro, folder, recorded_scans):
    write_tum(folder.parent / "p.tum", [(k * 17, pose) for k, pose in enumerate(recorded_scans[1])])
    code, _, err = hyrecro("map", folder, "--prior", "p.tum", "--trajectory", "t.tum", "--json")
    assert (code, err) == (0, "")
    poses = [pose for _, pose in read_tum(folder.parent / "t.tum")]
    assert compare_trajectories(poses, recorded_scans[1]).ate_rmse_m < 0.001
    write_tum(folder.parent / "short.tum", [(0, recorded_scans[1][0])])
    code, _, err = hyrecro("map", folder, "--prior", "short.tum")
    assert code == 2
    assert "short.tum: has 1 poses, must have one for each of 8 scans" in err


def test_refining_writes_a_trajectory_that_is_as_good(hyrecro, folder, recorded_scans):
    code, out, _ = hyrecro("map", folder, "--refine", "--trajectory", "t.tum", "--json")
    poses = [pose for _, pose in read_tum(folder.parent / "t.tum")]
    assert code == 0
    assert json.loads(out)["refine_ms"] > 0
    assert compare_trajectories(poses, recorded_scans[1]).ate_rmse_m < 0.001


def truncated(path):
    path.write_bytes(path.read_bytes()[:5000])


def empty(path):
    write_cloud(path, np.empty((0, 3)))


def not_numbers(path):
    write_cloud(path, np.full((100, 3), np.nan))


def two_points(path):
    write_cloud(path, np.array([[1.0, 2.0, 3.0], [2.0, 1.0, 0.0]]))


def millimetres(path):
    write_cloud(path, read_cloud(path).points_m * 1000)


def missing(path):
    path.unlink()


@pytest.mark.parametrize("spoil", [truncated, empty, not_numbers, two_points, millimetres, missing])
def test_a_bad_cloud_is_named_and_the_rest_is_mapped(hyrecro, folder, recorded_scans, spoil):
    spoil(folder / "data3.pcd")
    code, out, err = hyrecro("map", folder, "--trajectory", "t.tum", "--json")
    figures = json.loads(out)
    poses = dict(read_tum(folder.parent / "t.tum"))
    assert code == 3
    assert len([line for line in err.splitlines() if "data3.pcd" in line]) == 1
    assert figures["scans"] - figures["lost_scans"] == NUM_SCANS - 1
    kept = [k for k in range(NUM_SCANS) if k != 3]
    error = compare_trajectories([poses[k * 10**9] for k in kept], [recorded_scans[1][k] for k in kept])
    assert error.ate_rmse_m < 0.002


@pytest.mark.parametrize("spoil", [truncated, empty, not_numbers, two_points, millimetres])
def test_where_no_cloud_can_be_used_there_is_one_error(hyrecro, folder, spoil):
    for path in folder.iterdir():
        spoil(path)
    code, out, err = hyrecro("map", folder)
    assert (code, out) == (1, "")
    assert err.splitlines()[-1] == f"hyrecro: {folder}: none of 8 scans could be mapped"


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("nowhere",), "nowhere: must be a folder with data0.pcd"),
        (("scans", "--method", "magic"), "no method 'magic'"),
        (("scans", "--method", "mine.py:Icp"), "mine.py"),
        (("scans", "--scan-to", "moon"), "mapper.scan_to"),
        (("scans", "--crop=1,0,0,1,0,1"), "mapper.crop_m"),
        (("scans", "--crop=1,2"), "mapper.crop_m"),
        (("scans", "--voxel", "0"), "mapper.voxel_size_m"),
        (("scans", "--map", "m.stl"), "m.stl"),
        (("scans", "--map", "nowhere/m.pcd"), "nowhere/m.pcd: there is no folder nowhere"),
    ],
)
def test_wrong_usage_is_told_before_work_begins(hyrecro, folder, words, text):
    code, out, err = hyrecro("map", *words)
    assert (code, out) == (2, "")
    assert text in err
