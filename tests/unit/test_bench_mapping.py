import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.leg_prior import Posture, leg_odometry, lidar_on_hip, read_postures
from bench.mapping.contenders import CONTENDERS, Contender, Launcher
from bench.mapping.measuring import Run, RunError, parse_run, timing_of
from bench.mapping.queueing import num_dropped
from bench.mapping.scans import in_gate, read_scan_set, shifted, write_npz
from bench.mapping.scoring import num_pairs_ok, num_silent, score, structure_of
from bench.mapping.table import Row, markdown
from bench.mapping_errors import CASES, Row as ErrorRow, markdown as error_table
from bench.scan_data import Path6, poses_clear_of, random_path, turned, write_scans
from shared.errors import InputFileError
from shared.geometry import SE3
from shared.messaging.messages import Foot
from shared.robot.kinematics import T_fixed_free
from shared.runtime.sensor_config import LidarConfig
from shared.solids import Box
from shared.world.structure import Member, Structure

_ROOM = Structure(
    "room",
    (
        Member("left", Box((0.2, 8.0, 4.0)), SE3.trans(x_m=-3.0)),
        Member("back", Box((8.0, 0.2, 4.0)), SE3.trans(y_m=3.0)),
        Member("floor", Box((8.0, 8.0, 0.2)), SE3.trans(z_m=-1.5)),
    ),
    None,
)


def test_a_method_quicker_than_the_sensor_misses_nothing() -> None:
    assert num_dropped([99.0] * 50, 100.0) == 0
    assert num_dropped([100.0] * 50, 100.0) == 0


def test_at_two_and_a_half_periods_the_newest_waits() -> None:
    # taken at 0 ms scan 0, at 250 scan 2, at 500 scan 5, at 750 scan 7 ...: two of five
    assert num_dropped([250.0] * 20, 100.0) == 20 - 9  # 0 2 5 7 10 12 15 17 19


def test_one_slow_scan_costs_what_comes_during_it_but_the_newest() -> None:
    scan_ms = [10.0, 450.0, *[10.0] * 10]
    assert num_dropped(scan_ms, 100.0) == 3  # busy from 100 to 550: 2, 3 and 4 are gone, 5 was the newest


def test_the_last_scan_is_taken_late() -> None:
    assert num_dropped([1000.0, 1.0, 1.0], 100.0) == 1
    assert num_dropped([], 100.0) == 0


def _line(pose: SE3, ms: float, **more: object) -> str:
    return json.dumps({"ms": ms, "cpu_ms": ms / 2, "pose": pose.matrix.ravel().tolist(), **more})


def test_a_run_is_read_from_its_lines() -> None:
    poses = [SE3.identity(), SE3.trans(1.0)]
    lines = [_line(poses[0], 5.0, is_lost=False), "a warning", _line(poses[1], 7.0, is_lost=True)]
    refined = {"refined": [pose.matrix.ravel().tolist() for pose in poses], "refine_ms": 3.0}
    run = parse_run("\n".join([*lines, json.dumps({"added_rss_mb": 80.5}), json.dumps(refined)]))
    assert run.ms == (5.0, 7.0)
    assert run.cpu_ms == (2.5, 3.5)
    assert run.is_lost == (False, True)
    assert parse_run(_line(poses[0], 1.0)).is_lost is None
    assert run.added_rss_mb == 80.5
    assert run.refined is not None
    np.testing.assert_array_equal(run.refined[1].translation, [1.0, 0.0, 0.0])
    assert run.refine_ms == 3.0


@pytest.mark.parametrize("text", ["", "no word of scans", '{"ms": 1', '{"ms": 1, "cpu_ms": 1, "pose": [1, 2]}'])
def test_other_words_are_an_error(text: str) -> None:
    with pytest.raises(RunError):
        parse_run(text)


def test_timing_leaves_out_the_first_scan_and_takes_medians_of_runs() -> None:
    poses = (SE3.identity(),) * 3
    runs = [Run((0.0, ms, ms), (900.0, ms, 3 * ms), poses) for ms in (10.0, 20.0, 60.0)]
    timing = timing_of(runs)
    assert timing.ms_mean == 40.0
    assert timing.wall_ms_mean == 20.0
    assert timing.num_dropped_10hz == 1  # 900 ms of the first: scan 1 is gone when it ends
    refining = timing_of([replace(run, refine_ms=6.0) for run in runs])
    assert refining.ms_mean == pytest.approx(42.0)


def test_points_are_gated_and_moved_along_their_rays() -> None:
    points_m = np.array([[0.3, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, 11.0]], dtype=np.float32)
    assert in_gate(points_m).tolist() == [False, True, False]
    np.testing.assert_allclose(shifted(points_m[1:2], 0.05), [[3.03, 4.04, 0.0]], rtol=1e-6)


def test_a_path_begins_at_its_phases_and_travels() -> None:
    path = Path6(np.arange(6.0), np.ones((2, 6)), np.zeros((2, 6)), np.array([4.0, 0, 0, 0, 0, 0]))
    np.testing.assert_allclose(path.at(0.0).translation, [0.0, 1.0, 2.0])
    np.testing.assert_allclose(path.at(1.0).translation, [4.0, 1.0, 2.0], atol=1e-12)
    np.testing.assert_allclose(path.at(0.25).translation, [2.0, 2.0, 3.0], atol=1e-12)  # sines: 1 and 0


def test_paths_keep_clear_of_the_steel_or_there_are_none() -> None:
    rng = np.random.default_rng(1)
    reach = np.array([2.0, 2.0, 1.0, 0.3, 0.3, 1.0])
    poses = poses_clear_of(_ROOM, lambda: random_path(np.zeros(6), reach, np.zeros(6), rng), 20, 0.3)
    x, y, z = np.array([pose.translation for pose in poses]).T
    assert x.min() >= -2.6
    assert y.max() <= 2.6
    assert z.min() >= -1.1
    inside = np.array([-3.0, 0, 0, 0, 0, 0])
    with pytest.raises(ValueError, match=r"0\.3 m"):
        poses_clear_of(_ROOM, lambda: random_path(inside, np.zeros(6), np.zeros(6), rng), 5, 0.3, 3)


def test_scans_of_a_flight_score_as_true_and_wrong_poses_do_not(tmp_path: Path) -> None:
    config = LidarConfig.model_validate({"preset": "ideal", "self_hits": False})
    poses = [SE3.from_rpy([0.1, 0.0, 0.3 + 0.2 * k], [0.1 * k, 0.2, 0.0]) for k in range(3)]
    write_scans(tmp_path / "flight", _ROOM, poses, config, seed=1)
    scan_set = read_scan_set(tmp_path / "flight")
    structure = structure_of(scan_set.directory)
    write_npz(scan_set, tmp_path / "flight.npz")
    with np.load(tmp_path / "flight.npz") as archive:
        assert archive["starts"].tolist()[-1] == len(archive["points"]) == sum(map(len, scan_set.scans_m))
    best = score([poses[0].inv() @ pose for pose in poses], scan_set, structure)
    assert best.ate_mm < 1e-6
    assert best.num_pairs_ok == best.num_pairs == 2
    assert best.map_accuracy_mm < 2.0  # voxel means cut corners
    wrong = score([pose @ SE3.trans(0.06 * (k == 2)) for k, pose in enumerate(poses)], scan_set, structure)
    assert wrong.ate_mm == pytest.approx(60.0 / np.sqrt(3))
    assert wrong.num_pairs_ok == 1
    assert wrong.map_accuracy_mm > best.map_accuracy_mm + 1.0


def test_as_many_poses_as_scans_are_asked_for(tmp_path: Path) -> None:
    (tmp_path / "truth.tum").write_text("0 0 0 0 0 0 0 1\n")
    with pytest.raises(InputFileError, match="0 scans, but 1 poses"):
        read_scan_set(tmp_path)


def test_steps_are_right_within_five_centimetres_and_a_degree() -> None:
    truth = [SE3.identity()] * 4
    estimate = [SE3.identity(), SE3.trans(0.049), SE3.trans(0.1), SE3.trans(0.1) @ SE3.rot("z", np.deg2rad(1.1))]
    assert num_pairs_ok(estimate, truth) == 1
    assert num_silent(estimate, truth, [False] * 4) == 2
    assert num_silent(estimate, truth, [False, False, False, True]) == 1
    assert num_silent(estimate, truth, [False, False, True, False]) == 0


def test_legs_know_where_the_lidar_is(tmp_path: Path) -> None:
    T_footA_lidar = next(leg_odometry([Posture(0, np.zeros(8), Foot.A)], lidar_on_hip()))
    np.testing.assert_allclose(T_footA_lidar.translation, [0.075, 0.0, 0.3565], atol=1e-12)
    q = np.array([0.3, 0.01, 0.2, 0.4, 0.6, 0.4, -0.01, 0.2])
    before, after = leg_odometry([Posture(0, q, Foot.A), Posture(1, q, Foot.B)], lidar_on_hip())
    np.testing.assert_allclose(after.matrix, before.matrix, atol=1e-12)
    moved = q + np.array([0, 0, 0, 0, 0, 0.1, 0, 0.05])
    *_, last = leg_odometry([Posture(0, q, Foot.A), Posture(1, q, Foot.B), Posture(2, moved, Foot.B)], lidar_on_hip())
    T_footB_footA = T_fixed_free(moved, Foot.B)
    expected = T_fixed_free(q, Foot.A) @ T_footB_footA @ next(leg_odometry([Posture(0, moved, Foot.A)], lidar_on_hip()))
    np.testing.assert_allclose(last.matrix, expected.matrix, atol=1e-12)


def test_postures_are_read_as_simulate_writes_them(tmp_path: Path) -> None:
    path = tmp_path / "joints.csv"
    path.write_text("t,q1,q2,q3,q4,q5,q6,q7,q8,fixed_foot\n1.250000000,1,2,3,4,5,6,7,8,B\n")
    (posture,) = read_postures(path)
    assert posture.stamp_ns == 1_250_000_000
    assert posture.q.tolist() == [1, 2, 3, 4, 5, 6, 7, 8]
    assert posture.fixed_foot is Foot.B


def test_a_turned_structure_keeps_its_shape() -> None:
    there = turned(_ROOM, [10.0, 20.0, 30.0])
    back = SE3.from_rpy(np.deg2rad([10.0, 20.0, 30.0])).inv()
    for before, after in zip(_ROOM.members, there.members, strict=True):
        np.testing.assert_allclose((back @ after.T_world_member).matrix, before.T_world_member.matrix, atol=1e-12)


def test_tables_name_who_was_not_measured() -> None:
    text = markdown([Row("PCL", problem="not built")])
    assert text.splitlines()[-1] == "- PCL: not built"
    row = ErrorRow("bent", "plane:map", 11, 1.234, 0.5, 9, 1, 0, 2.0, 3.0, 100.4)
    assert "| bent | plane:map | 11 | 1.23 | 0.50 | 9 of 10 | 1 / 0 | 2.00 / 3.00 | 100 |" in error_table([row])
    assert "| exit code 1 |" in error_table([ErrorRow("bent", "gicp:map", 11, problem="exit code 1")])


def test_contenders_have_lines_of_their_own_and_peers_that_are_absent_say_so(tmp_path: Path) -> None:
    assert len({contender.label for contender in CONTENDERS}) == len(CONTENDERS)
    launcher = Launcher(tmp_path / "no-python")
    ours = next(contender for contender in CONTENDERS if contender.is_ours)
    assert launcher.absence(ours) is None
    command = launcher.command(ours, tmp_path, Path("a.npz"), Path("guesses.txt"))
    assert command[1:3] == ["-m", "bench.mapping.our_runner"]
    assert command[-1] == "guesses.txt"
    kiss = Contender("python", "KISS-ICP", "kiss_icp", 0.15)
    assert launcher.absence(kiss) in (None, "kiss-icp is not installed")
    genz = Contender("python", "GenZ-ICP", "genz_icp", 0.2, takes_prior=False)
    assert launcher.command(genz, tmp_path, Path("a.npz"), Path("guesses.txt"))[-1] == "0.2"


def test_cases_that_share_a_folder_are_made_alike() -> None:
    made: dict[str, list[str]] = {}
    for case in CASES:
        assert made.setdefault(case.folder, case.make) == case.make
