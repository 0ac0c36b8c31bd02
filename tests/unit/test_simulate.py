import json
from pathlib import Path

import numpy as np
import pytest
from pypcd4 import PointCloud
from rich.progress import Progress

from cli.simulate import simulate
from shared.errors import InputFileError, PlaybackError, RefusedError
from shared.runtime.config_loading import load_config

ROWS = "q1,q2,q3,q4,q5,q6,q7,q8\n0.2,0,0,0,0,0,0,0\nC,C,C,C,C,C,C,C\n0.2,0,0,0.3,0,0,0,0\n"
SMALL = ["player.speed_radps=0.3"]


def config_of(tmp_path, rows=ROWS, *overrides):
    path = tmp_path / "climb.csv"
    path.write_text(rows)
    return load_config(overrides=[f"player.trajectory={path}", *SMALL, *overrides])


def written(config, out, num_scans=3):
    num = simulate(config, out, num_scans, Progress(disable=True))
    return num, {path.name: path.read_bytes() for path in out.iterdir()}


def test_scans_labels_truth_and_joints_belong_together(tmp_path):
    num, files = written(config_of(tmp_path), tmp_path / "run")
    assert num == 3
    scans = {name for i in range(3) for name in (f"data{i}.pcd", f"labels{i}.npy", f"ranges{i}.npy")}
    assert set(files) == scans | {"labels.json", "truth.tum", "joints.csv"}
    names = json.loads(files["labels.json"])
    truth = np.loadtxt(tmp_path / "run" / "truth.tum")
    joints = (tmp_path / "run" / "joints.csv").read_text().splitlines()
    assert truth.shape == (3, 8)
    assert joints[0] == "t,q1,q2,q3,q4,q5,q6,q7,q8,fixed_foot"
    assert joints[1] == "0.000000000,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,A"
    assert joints[-1].split(",")[1:] == ["0.2", "0.0", "0.0", "0.3", "0.0", "0.0", "0.0", "0.0", "B"]
    assert float(joints[-1].split(",")[0]) == truth[-1, 0]
    for i in range(3):
        cloud = PointCloud.from_path(Path(tmp_path / "run" / f"data{i}.pcd"))
        labels = np.load(tmp_path / "run" / f"labels{i}.npy")
        assert cloud.fields == ("x", "y", "z", "intensity", "t", "ring")
        assert len(cloud.numpy()) == len(labels) > 100
        ranges_m = np.linalg.norm(cloud.numpy(("x", "y", "z")), axis=1)
        assert np.std(ranges_m - np.load(tmp_path / "run" / f"ranges{i}.npy")) == pytest.approx(0.008, rel=0.05)
        assert 0 <= labels[:, 0].min() <= labels[:, 0].max() < len(names["members"])


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(tmp_path):
    erring = ["sim.encoders.bias_rad=0.005", "sim.encoders.noise_rad=0.001", "player.position_tolerance=0.1"]
    first, second, other = (
        written(config_of(tmp_path, ROWS, f"seed={seed}", *erring), tmp_path / name)[1]
        for seed, name in ((5, "a"), (5, "b"), (6, "c"))
    )
    assert first == second
    assert first["data1.pcd"] != other["data1.pcd"]
    assert first["joints.csv"] != other["joints.csv"]
    assert first["truth.tum"] != other["truth.tum"], "drives that trust their encoders go elsewhere"


def test_without_a_number_it_scans_at_the_sensors_rate(tmp_path):
    num, _ = written(config_of(tmp_path), tmp_path / "run", num_scans=None)
    truth = np.loadtxt(tmp_path / "run" / "truth.tum")
    assert num == len(truth) > 20
    np.testing.assert_allclose(np.diff(truth[:, 0]), 0.1, atol=0.011)


def test_a_folder_with_files_is_left_alone(tmp_path):
    out = tmp_path / "run"
    out.mkdir()
    (out / "mine.txt").write_text("x")
    with pytest.raises(InputFileError, match="must be a folder that is empty"):
        simulate(config_of(tmp_path), out, 1, Progress(disable=True))
    assert [path.name for path in out.iterdir()] == ["mine.txt"]


def test_a_climb_that_cannot_be_carried_out_leaves_nothing(tmp_path):
    beyond = ROWS.replace("0.3", "9.3")
    with pytest.raises(RefusedError, match="q4 is"):
        simulate(config_of(tmp_path, beyond), tmp_path / "run", 1, Progress(disable=True))
    falling = ["sim.mode=dynamic", "sim.magnets.pull_n=5"]
    with pytest.raises(PlaybackError, match="line 2: foot A lets go"):
        simulate(config_of(tmp_path, ROWS, *falling), tmp_path / "run", 1, Progress(disable=True))
    assert not (tmp_path / "run").exists()
