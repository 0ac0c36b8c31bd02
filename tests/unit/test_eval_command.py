import json
import sys

import numpy as np
import pytest

from cli import main as command_line
from shared.cloud_files import write_cloud
from shared.geometry import SE3
from shared.runtime.config import CONFIGS_DIR
from shared.solids import Box
from shared.trajectory_files import write_tum
from shared.world.files import save_structure
from shared.world.structure import Member, Structure

T_WORLD_START = SE3.trans(0.0, 0.0, 1.0) @ SE3.rot("z", 0.5)
"""Where the sensor is at first: one metre over the top of the steel, which is at z = 0."""
KEYS = {
    "ate_rmse_m", "ate_rot_rmse_deg", "rpe_rmse_m", "rpe_rot_rmse_deg", "drift_m", "pairs_ok", "map_accuracy_mean_m",
    "map_accuracy_p95_m", "completeness_5cm", "chamfer_m", "fscore_2cm", "mme", "off_plane_points", "num_pairs",
    "rpe_by_distance",
}  # fmt: skip


def path(step_m, num_poses=11):
    return [SE3.trans(x_m=step_m * k, y_m=0.05 * (k % 2)) for k in range(num_poses)]


def top(spacing_m=0.02):
    steps = np.arange(-1 + spacing_m / 2, 1, spacing_m)
    x, y = np.meshgrid(steps, steps)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


@pytest.fixture(autouse=True)
def _files(tmp_path, monkeypatch):
    """Truth at 10 Hz; an estimate that is 1 % too short; a map of the top in the frame of the first scan."""
    monkeypatch.chdir(tmp_path)
    write_tum(tmp_path / "t.tum", [(k * 10**8, T_WORLD_START @ pose) for k, pose in enumerate(path(0.1))])
    write_tum(tmp_path / "e.tum", [(k * 10**8 + 10**6, pose) for k, pose in enumerate(path(0.099))])
    write_cloud(tmp_path / "m.ply", T_WORLD_START.inv().apply(top()))
    slab = Member("slab", Box((2.0, 2.0, 0.2)), SE3.trans(0.0, 0.0, -0.1))
    save_structure(Structure("s", (slab,), None), tmp_path / "s.yaml")


def run(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["hyrecro", "eval", *words])
    with pytest.raises(SystemExit) as caught:
        command_line.main()
    captured = capsys.readouterr()
    return caught.value.code, captured.out, captured.err


TRAJECTORIES = ("--estimate", "e.tum", "--truth", "t.tum")
MAP = ("--map", "m.ply", "--structure", "s.yaml")


def figures(monkeypatch, capsys, *words):
    code, out, err = run(monkeypatch, capsys, *words, "--json")
    assert code == 0, err
    return json.loads(out)


def test_the_figures_as_json(monkeypatch, capsys, tmp_path):
    found = figures(monkeypatch, capsys, *TRAJECTORIES, *MAP)
    assert set(found) >= KEYS
    assert found["drift_m"] == pytest.approx(0.01)
    assert found["ate_rmse_m"] == pytest.approx(0.001 * np.sqrt(385 / 11))
    assert (found["num_pairs"], found["pairs_ok"]) == (10, 10)
    assert found["rpe_by_distance"][0]["length_m"] == 0.1
    assert found["map_accuracy_mean_m"] == pytest.approx(0.0, abs=1e-9)
    assert found["completeness_2cm"] == 1.0
    assert found["off_plane_points"] == 0
    assert not (tmp_path / "out").exists()
    assert figures(monkeypatch, capsys, *TRAJECTORIES, *MAP) == found


def test_without_a_map_its_figures_are_null(monkeypatch, capsys):
    found = figures(monkeypatch, capsys, *TRAJECTORIES)
    assert set(found) >= KEYS
    assert (found["chamfer_m"], found["mme"], found["off_plane_points"]) == (None, None, None)


def test_each_alignment_moves_trajectory_and_map(monkeypatch, capsys):
    least = figures(monkeypatch, capsys, *TRAJECTORIES, *MAP, "--align", "umeyama")
    assert least["ate_rmse_m"] == pytest.approx(0.001 * np.sqrt(10), rel=1e-3)
    assert least["map_accuracy_mean_m"] < 0.002
    as_it_is = figures(monkeypatch, capsys, *TRAJECTORIES, *MAP, "--align", "none")
    assert as_it_is["ate_rmse_m"] > 1.0
    assert as_it_is["map_accuracy_mean_m"] == pytest.approx(0.8, abs=0.2)  # the slab is a metre over the map


def test_the_table_and_the_pictures(monkeypatch, capsys, tmp_path):
    code, out, _ = run(monkeypatch, capsys, *TRAJECTORIES, *MAP)
    assert code == 0
    assert "steps within 5 cm and 1 deg │ 10 of 10" in out
    assert "points off the planes" in out
    names = {"eval.json", "trajectory.png", "errors.png", "map_distances.png"}
    assert {file.name for file in (tmp_path / "out" / "latest").iterdir()} == names
    run(monkeypatch, capsys, *TRAJECTORIES, "--json", "--out", "a/b")
    assert {file.name for file in (tmp_path / "a" / "b").iterdir()} == names - {"map_distances.png"}


def test_stamps_that_count_the_scans_are_paired_by_index(monkeypatch, capsys, tmp_path):
    write_tum(tmp_path / "e.tum", [(k * 10**9, pose) for k, pose in enumerate(path(0.1)) if k != 7])
    code, out, err = run(monkeypatch, capsys, *TRAJECTORIES, "--json")
    assert code == 0
    assert "e.tum: its stamps count the poses of t.tum" in err
    assert json.loads(out)["num_poses"] == 10
    assert json.loads(out)["ate_rmse_m"] == pytest.approx(0.0, abs=1e-9)


def test_whole_seconds_that_the_truth_has_are_no_indices(monkeypatch, capsys, tmp_path):
    """Truth over 1 s at 10 Hz; of four estimates, two are later."""
    write_tum(tmp_path / "t.tum", [(k * 10**8, pose) for k, pose in enumerate(path(0.1, 15))])
    write_tum(tmp_path / "e.tum", [(k * 10**9, path(0.1, 11)[10 * (k % 2)]) for k in range(4)])
    code, out, err = run(monkeypatch, capsys, *TRAJECTORIES, "--json")
    assert (code, json.loads(out)["num_poses"]) == (0, 2)
    assert "2 of 4 poses have none within" in err
    assert json.loads(out)["drift_m"] == pytest.approx(0.0, abs=1e-9)


def test_poses_without_a_partner_are_told(monkeypatch, capsys, tmp_path):
    write_tum(tmp_path / "long.tum", [(k * 10**8, pose) for k, pose in enumerate(path(0.1, 14))])
    code, out, err = run(monkeypatch, capsys, "--estimate", "long.tum", "--truth", "e.tum", "--json")
    assert (code, json.loads(out)["num_poses"]) == (0, 11)
    assert err == "hyrecro: long.tum: 3 of 14 poses have none within 0.02 s in e.tum\n"
    code, _, err = run(monkeypatch, capsys, *TRAJECTORIES, "--max-dt", "0.0005")
    assert code == 1
    assert err == "hyrecro: e.tum: no stamp is within 0.0005 s of one in t.tum\n"


@pytest.mark.parametrize(
    ("words", "code", "reason"),
    [
        (["--estimate", "no.tum", "--truth", "t.tum"], 2, "hyrecro: no.tum: No such file"),
        ([*TRAJECTORIES, "--map", "no.pcd", "--structure", "s.yaml"], 2, "hyrecro: no.pcd: No such file"),
        ([*TRAJECTORIES, "--map", "m.ply", "--structure", "no.yaml"], 2, "hyrecro: no.yaml: No such file"),
        ([*TRAJECTORIES, "--map", "m.ply"], 2, "--map and --structure belong together"),
        ([*TRAJECTORIES, "--align", "sim3"], 2, "'sim3' is none of first, umeyama, none"),
        (["--estimate", "s.yaml", "--truth", "t.tum"], 1, "hyrecro: s.yaml: line 1: "),
        ([*TRAJECTORIES, "--map", "cut.pcd", "--structure", "s.yaml"], 1, "hyrecro: cut.pcd: the header says 4 points"),
        ([*TRAJECTORIES, "--map", "empty.pcd", "--structure", "s.yaml"], 1, "hyrecro: empty.pcd: has no points"),
        ([*TRAJECTORIES, "--map", "nan.pcd", "--structure", "s.yaml"], 1, "has no points that are finite"),
    ],
)
def test_what_cannot_be_used_gets_one_error(monkeypatch, capsys, tmp_path, words, code, reason):
    write_cloud(tmp_path / "cut.pcd", np.ones((4, 3)))
    (tmp_path / "cut.pcd").write_bytes((tmp_path / "cut.pcd").read_bytes()[:-3])
    write_cloud(tmp_path / "empty.pcd", np.empty((0, 3)))
    write_cloud(tmp_path / "nan.pcd", np.full((4, 3), np.nan))
    ended, out, err = run(monkeypatch, capsys, *words, "--json")
    assert (ended, out) == (code, "")
    assert reason in " ".join(err.replace("│", " ").split())


def test_a_map_in_millimetres_or_with_nan_is_told(monkeypatch, capsys, tmp_path):
    write_cloud(tmp_path / "mm.ply", np.concatenate([top(0.1) * 1000, np.full((2, 3), np.nan)]))
    _, _, err = run(monkeypatch, capsys, *TRAJECTORIES, "--map", "mm.ply", "--structure", "s.yaml", "--json")
    assert "mm.ply: 2 of 402 points are not finite" in err
    assert "mm.ply: the median point is 7" in err
    assert "millimetres" in err


@pytest.mark.parametrize("suffix", ["urdf", "sdf", "stl"])
def test_the_structure_may_be_of_any_format(monkeypatch, capsys, tmp_path, suffix):
    from shared.world.files import load_structure

    save_structure(load_structure(tmp_path / "s.yaml"), tmp_path / f"s.{suffix}")
    words = ("--map", "m.ply", "--structure", f"s.{suffix}")
    assert figures(monkeypatch, capsys, *TRAJECTORIES, *words)["map_accuracy_mean_m"] < 1e-6


def test_the_shipped_structure_can_be_compared_with(monkeypatch, capsys):
    words = ("--map", "m.ply", "--structure", str(CONFIGS_DIR / "structures" / "original.yaml"))
    assert figures(monkeypatch, capsys, *TRAJECTORIES, *words)["map_accuracy_mean_m"] < 1.0  # from the ground
