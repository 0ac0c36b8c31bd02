"""`hyrecro demo` as people run it, on a short climb; Ctrl-C and kills at any time leave nothing behind."""

import contextlib
import json
import os
import shlex
import signal
import subprocess

import numpy as np
import psutil
import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from PIL import Image
from pypcd4 import PointCloud

from tests.e2e.conftest import ALL_SERVICES, wait_for_services
from tests.support.documents import commands
from tests.support.processes import BIN, ROOT, free_endpoint, hyrecro_command, run, started, wait_until

pytestmark = pytest.mark.e2e

FILES = {"run.mcap", "map.pcd", "map.png", "trajectory.tum", "truth.tum", "report.json"}


@pytest.fixture(scope="module")
def short_climb(tmp_path_factory):
    """The first two moves of the project's climb."""
    lines = (ROOT / "configs" / "trajectories" / "climb.csv").read_text().splitlines(keepends=True)
    path = tmp_path_factory.mktemp("climb") / "short.csv"
    path.write_text("".join(lines[:5]))
    return path


@pytest.fixture(scope="module")
def demo(short_climb, tmp_path_factory):
    directory = tmp_path_factory.mktemp("demo")
    settings = [f"player.trajectory={short_climb}", "player.num_steps=60", f"bus.endpoint={free_endpoint()}"]
    settings += [f"recorder.directory={directory}"]
    result = run("hyrecro", "demo", "--json", *(part for setting in settings for part in ("--set", setting)))
    assert result.returncode == 0, result.stderr
    return directory / "latest", json.loads(result.stdout)


def test_it_leaves_all_files_and_the_same_report(demo):
    folder, figures = demo
    assert {path.name for path in folder.iterdir()} >= FILES
    assert json.loads((folder / "report.json").read_text()) == figures


def test_it_is_accurate_and_loses_nothing(demo):
    _, figures = demo
    assert 0 < figures["ate_rmse_m"] < 0.02
    assert 0 < figures["rpe_rmse_m"] < 0.02
    assert 0 < figures["map_accuracy_mean_m"] < 0.02
    assert figures["off_plane_points"] <= figures["off_plane_points_true_poses"]
    assert figures["ms_per_scan_p50"] > 0
    assert figures["lost_messages"] == 0
    scans = figures["channels"]["hyrecro/lidar/points"]
    assert scans["published"] == scans["received"] > 50
    assert all(counts["lost"] == 0 for counts in figures["channels"].values())


def test_map_and_trajectories_are_in_the_world(demo):
    folder, figures = demo
    points = PointCloud.from_path(folder / "map.pcd").numpy(("x", "y", "z"))
    assert len(points) == figures["map_points"]
    assert np.abs(points[:, :2]).max() < 2.3
    true, estimated = (np.loadtxt(folder / f"{name}.tum") for name in ("truth", "trajectory"))
    assert true.shape == estimated.shape == (figures["num_poses"], 8)
    np.testing.assert_allclose(true[0, 1:4], [0.0, -0.7, 10.4615], atol=1e-6)
    errors = np.linalg.norm(true[:, 1:4] - estimated[:, 1:4], axis=1)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(figures["ate_rmse_m"])


def test_the_picture_shows_something(demo):
    pixels = np.asarray(Image.open(demo[0] / "map.png").convert("RGB"))
    assert pixels.shape[0] > 400
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 100


def test_the_tutorial_maps_and_scores_the_recording(demo, tmp_path, monkeypatch):
    """Every command after `hyrecro demo`, in the order in which people type them."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "latest").symlink_to(demo[0].resolve())
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    first, *others = commands("tutorials/recording_to_map.md", "hyrecro")
    assert first == "hyrecro demo"
    ran = [run(*shlex.split(line), cwd=tmp_path) for line in others]
    assert [result.returncode for result in ran] == [0] * len(others), [result.stderr for result in ran]
    assert (tmp_path / "planes" / "planes.png").stat().st_size > 10_000
    score = json.loads((tmp_path / "score" / "eval.json").read_text())
    assert score["ate_rmse_m"] < 0.02
    assert score["map_accuracy_mean_m"] < 0.02


def test_ctrl_c_leaves_no_process_and_a_whole_file(short_climb, tmp_path):
    command = hyrecro_command("demo", "--set", f"player.trajectory={short_climb}")
    with started(command, tmp_path) as running:
        wait_for_services(running, {*ALL_SERVICES, "player"})
        children = running.children()
        assert running.stop(signal.SIGINT) == 130
    assert [child for child in children if child.is_running()] == []
    assert run("rerun", "mcap", "check", tmp_path / "latest" / "run.mcap").returncode == 0


@pytest.mark.parametrize("log", ["router.log", "mapper.log"])
def test_ctrl_c_while_it_starts_leaves_no_process_either(log, tmp_path):
    with started(hyrecro_command("demo"), tmp_path) as running:
        wait_until(lambda: list(tmp_path.glob(f"*/logs/{log}")), f"{log}, the sign that this process was started")
        children = running.children()
        assert running.stop(signal.SIGINT) == 130
    assert [child for child in children if child.is_running()] == []
    assert "Traceback" not in (tmp_path / "stderr.txt").read_text()


def test_a_killed_launcher_takes_its_services_along(tmp_path):
    with started(hyrecro_command("up"), tmp_path) as running:
        wait_for_services(running, ALL_SERVICES)
        children = running.children()
        running.stop(signal.SIGKILL)
        assert psutil.wait_procs(children, timeout=20)[1] == []
    assert run("rerun", "mcap", "check", tmp_path / "latest" / "run.mcap").returncode == 0


def test_a_killed_recorder_leaves_a_readable_file(tmp_path):
    with started(hyrecro_command("up"), tmp_path) as running:
        wait_for_services(running, ALL_SERVICES)
        (recorder,) = (child for child in running.children() if "services.recorder" in child.cmdline())
        wait_until(lambda: running.state()["stamp_s"] > 2, "two seconds of simulated time")
        os.kill(recorder.pid, signal.SIGKILL)
        said = "recorder was killed by SIGKILL, is started again now"
        wait_until(lambda: said in (tmp_path / "stderr.txt").read_text(), "the supervisor's word")
    assert last_whole_stamp_ns(tmp_path / "latest" / "run.mcap") > 1e9, "all but the last second is there"


def last_whole_stamp_ns(path):
    """The newest stamp in the whole chunks of a file that was not finished."""
    newest_ns = 0
    with path.open("rb") as file, contextlib.suppress(McapError):
        for _, _, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            newest_ns = max(newest_ns, message.log_time)
    return newest_ns


def test_play_says_where_a_trajectory_is_refused(tmp_path):
    (tmp_path / "far.csv").write_text("q1,q2,q3,q4,q5,q6,q7,q8\n0,0,0,0,0,0,0,0.1\n9,0,0,0,0,0,0,0\n")
    with started(hyrecro_command("up"), tmp_path / "up") as running:
        wait_for_services(running, ALL_SERVICES)
        options = ("--rate", "50", "--steps", "5")
        played = running.hyrecro("robot", "play", tmp_path / "far.csv", *options)
        assert played.returncode == 1
        assert "line 3" in played.stderr
        assert "q1 is" in played.stderr
        missing = running.hyrecro("robot", "play", tmp_path / "nothing.csv")
        assert missing.returncode == 2
        assert "no such file" in missing.stderr


def test_an_interrupted_play_ends_at_once(short_climb, tmp_path):
    with started(hyrecro_command("up"), tmp_path) as running:
        wait_for_services(running, ALL_SERVICES)
        options = ["--set", f"bus.endpoint={running.endpoint}"]
        with subprocess.Popen([BIN / "hyrecro", "robot", "play", short_climb, *options]) as player:
            wait_for_services(running, {"player"})
            player.send_signal(signal.SIGINT)
            assert player.wait(10) == 130
