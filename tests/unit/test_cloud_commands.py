import json
import sys

import numpy as np
import pytest

from cli import main as command_line
from cli.cloud_filtering import FilterSteps, filtered_cloud
from cli.cloud_pictures import colours_of, plane_colour
from cli.cloud_saving import CloudSaver, Every, save_clouds
from services.mapper.filters import Verdict
from shared.cloud_files import read_cloud, write_cloud
from shared.cloud_planes import CloudPlane
from shared.errors import InputFileError
from shared.messaging.messages import LidarScan, PointCloud

RNG = np.random.default_rng(6)


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    """With two faces of 600 and 300 points, and 20 points on neither."""
    monkeypatch.chdir(tmp_path)
    floor, wall = RNG.uniform(0, 1, (600, 3)), RNG.uniform(0, 1, (300, 3))
    floor[:, 2], wall[:, 0] = 0.0, 2.0
    wall[:, 2] += 0.5
    stray = RNG.uniform(5, 9, (20, 3))
    write_cloud(tmp_path / "a.pcd", np.concatenate([floor, wall, stray]))


def run(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["hyrecro", "cloud", *words])
    with pytest.raises(SystemExit) as caught:
        command_line.main()
    captured = capsys.readouterr()
    return caught.value.code, captured.out, " ".join(captured.err.replace("│", " ").split())


def scan(num_points=3):
    per_point = {"intensity": [1.0] * num_points, "t_ns": range(num_points), "ring": [2] * num_points}
    return LidarScan(stamp_ns=0, seq=0, frame="lidar", points_m=np.ones((num_points, 3)), **per_point)


@pytest.mark.parametrize("method", ["ransac", "region"])
def test_planes_as_json_and_as_a_coloured_cloud(monkeypatch, capsys, tmp_path, method):
    words = ("planes", "a.pcd", "--max", "2", "--method", method, "--json", "--save", "b.ply")
    code, out, _ = run(monkeypatch, capsys, *words)
    assert code == 0
    figures = json.loads(out)
    assert [plane["inliers"] for plane in figures["planes"]] == [600, 300]
    np.testing.assert_allclose(np.abs(figures["planes"][0]["coefficients"]), [0, 0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(np.abs(figures["planes"][1]["coefficients"]), [1, 0, 0, 2], atol=1e-6)
    assert (figures["points"], figures["off_plane_points"]) == (920, 20)
    assert read_cloud(tmp_path / "b.ply").points_m.shape == (920, 3)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.pcd", "b.ply"]


def test_planes_as_text_with_a_picture(monkeypatch, capsys, tmp_path):
    code, out, _ = run(monkeypatch, capsys, "planes", "a.pcd", "--max", "1")
    assert code == 0
    assert "600 points\n920 points, 320 off the planes\n" in out
    assert (tmp_path / "out" / "latest" / "planes.png").read_bytes().startswith(b"\x89PNG")


def test_points_on_no_plane_are_black_and_planes_differ():
    colours = colours_of(5, [CloudPlane(np.zeros(4), np.array([0, 3])), CloudPlane(np.zeros(4), np.array([1]))])
    assert colours.tolist() == [list(plane_colour(k)) if k >= 0 else [0, 0, 0] for k in (0, 1, -1, 0, -1)]
    assert len({plane_colour(k) for k in range(50)}) == 50


@pytest.mark.parametrize(
    ("words", "code", "reason"),
    [
        (["planes"], 2, "either FILE or --live"),
        (["planes", "a.pcd", "--live"], 2, "either FILE or --live"),
        (["planes", "a.pcd", "--method", "hough"], 2, "'hough' is none of ransac, region"),
        (["planes", "a.pcd", "--threshold", "0"], 2, "--threshold: must be above 0"),
        (["planes", "no.pcd"], 2, "hyrecro: no.pcd: No such file"),
        (["planes", "a.pcd", "--json", "--save", "b.xyz"], 2, "b.xyz: clouds are written as"),
        (["planes", "--live", "--key", "tf"], 2, "--key tf: no clouds are on it; keys with clouds are lidar/points"),
        (["planes", "cut.pcd"], 1, "hyrecro: cut.pcd: the header says 1 points, the data hold 0: cut off"),
        (["planes", "empty.pcd"], 1, "hyrecro: empty.pcd: has no points"),
        (["planes", "two.pcd", "--json"], 3, "hyrecro: two.pcd: 2 points, no plane among them"),
        (["filter", "a.pcd", "b.pcd", "--crop", "1,2,3"], 2, "--crop: must be 6 numbers"),
        (["filter", "a.pcd", "b.pcd", "--crop=1,2,3,4,6,5"], 2, "--crop: each first number must be below"),
        (["filter", "a.pcd", "b.pcd", "--range", "1,x"], 2, "--range: must be 2 numbers"),
        (["filter", "a.pcd", "b.pcd", "--outliers", "1.5,2"], 2, "--outliers: must be a whole number"),
        (["filter", "a.pcd", "b.pcd", "--voxel", "0"], 2, "--voxel: must be above 0"),
        (["filter", "cut.pcd", "b.pcd"], 1, "cut.pcd: the header says"),
        (["filter", "empty.pcd", "b.pcd"], 3, "empty.pcd: has no points"),
        (["filter", "a.pcd", "b.pcd", "--range", "0,1e-9"], 3, "a.pcd: no point is left"),
        (["filter", "mm.pcd", "b.pcd", "--voxel", "0.0001"], 1, "mm.pcd: points reach"),
        (["save"], 2, "without a terminal there is no key to press: give --every S"),
        (["save", "--every", "1", "--key", "joints/state"], 2, "no clouds are on it"),
    ],
)
def test_what_cannot_be_done_gets_one_error(monkeypatch, capsys, tmp_path, words, code, reason):
    write_cloud(tmp_path / "cut.pcd", np.ones((1, 3)))
    (tmp_path / "cut.pcd").write_bytes((tmp_path / "cut.pcd").read_bytes()[:-3])
    for name, num_points in (("empty", 0), ("two", 2)):
        write_cloud(tmp_path / f"{name}.pcd", np.ones((num_points, 3)))
    write_cloud(tmp_path / "mm.pcd", RNG.uniform(-5000, 5000, (50, 3)))
    ended, _, err = run(monkeypatch, capsys, *words)
    assert ended == code, err
    assert reason in err


def test_filters_in_the_mappers_order(monkeypatch, capsys, tmp_path):
    write_cloud(
        tmp_path / "n.ply", [[0.1, 0, 0], [1, 0, 0], [1.01, 0, 0], [4, 0, 0], [9, 0, 0], [np.nan, 0, 0]] * np.ones(3)
    )
    words = ("--range", "0.5,8", "--crop=-9,3,-1,1,-1,1", "--voxel", "0.1")
    code, out, _ = run(monkeypatch, capsys, "filter", "n.ply", "b.las", *words)
    assert code == 0
    assert out == "n.ply: 6 points, 1 not finite, 2 out of range, 1 out of box\nb.las: 1 points\n"
    np.testing.assert_allclose(read_cloud(tmp_path / "b.las").points_m, [[1.005, 0, 0]], atol=1e-5)


def test_without_a_word_only_what_is_not_finite_goes():
    points = np.array([[0.0, 0, 0], [1e5, 0, 0], [np.inf, 0, 0]])
    left, counts = filtered_cloud(points, FilterSteps())
    np.testing.assert_array_equal(left, points[:2])
    assert counts[Verdict.NOT_FINITE] == 1


def test_outliers_go():
    points = np.concatenate([RNG.uniform(0, 1, (200, 3)), [[30.0, 0, 0]]])
    left, counts = filtered_cloud(points, FilterSteps(outliers=(5, 3.0)))
    assert counts[Verdict.OUTLIER] == 201 - len(left) >= 1
    assert np.abs(left).max() <= 1.0


def test_saved_clouds_go_on_in_the_numbering_and_keep_their_fields(tmp_path):
    assert CloudSaver(tmp_path / "new" / "folder").save(scan()).name == "data0.pcd"
    (tmp_path / "data7.pcd").touch()
    saver = CloudSaver(tmp_path)
    assert saver.save(scan()).name == "data8.pcd"
    cloud = PointCloud(stamp_ns=0, seq=0, frame="map", points_m=np.zeros((4, 3)))
    assert read_cloud(saver.save(cloud)).points_m.shape == (4, 3)
    assert read_cloud(tmp_path / "data8.pcd").t_ns.tolist() == [0, 1, 2]
    with pytest.raises(InputFileError, match=r"a\.pcd"):
        CloudSaver(tmp_path / "a.pcd")


class Scripted:
    """Gives a scan of k points at time k / 10, on a clock of its own; at every third moment nothing."""

    def __init__(self):
        self.now_s = 0.0

    def newest(self, timeout_s):
        self.now_s += timeout_s
        number = round(self.now_s / timeout_s)
        return None if number % 3 == 0 else scan(number)


def test_a_cloud_is_saved_every_so_often(tmp_path):
    stream, said = Scripted(), []
    trigger = Every(0.5, clock_s=lambda: round(stream.now_s, 6))
    assert save_clouds(stream, CloudSaver(tmp_path), trigger, 4, lambda: False, said.append) == 4
    sizes = [len(read_cloud(tmp_path / f"data{k}.pcd").points_m) for k in range(4)]
    assert sizes == [1, 7, 11, 16]  # 6 is silent; 11 and 16 are 0.5 s after 1 in tenths, not after the late one
    assert said[0] == f"{tmp_path / 'data0.pcd'}: 1 points"


def test_saving_ends_when_told(tmp_path):
    stream = Scripted()
    assert save_clouds(stream, CloudSaver(tmp_path), Every(0.0), None, lambda: stream.now_s > 0.95, print) == 7
