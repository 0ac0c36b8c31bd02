import csv
import json
from pathlib import Path

import pytest

from cli.sweep import Sweep
from cli.sweep_spec import cases_of, read_spec
from cli.sweep_table import csv_text, markdown_text, rows_of
from shared.errors import ConfigError, HyrecroError
from shared.geometry import SE3
from shared.runtime.config import CONFIGS_DIR
from shared.trajectory_files import write_tum

STRUCTURE = CONFIGS_DIR / "structures" / "original.yaml"


def cases(tmp_path, text):
    (tmp_path / "s.yaml").write_text(text)
    return cases_of(read_spec(tmp_path / "s.yaml"), tmp_path, STRUCTURE)


def test_every_combination_is_a_case(tmp_path):
    text = "simulate: {trajectory: trajectories/climb.csv, num_scans: 9}\nmethods: [gicp, plane]\nvoxels: [0.05, 0.1]\n"
    found = cases(tmp_path, text + "range_noise_m: [0.008, 0.03]\nseeds: [1, 2, 3]\n")
    assert len(found) == len({case.name for case in found}) == 2 * 2 * 2 * 3
    assert len({case.scans for case in found}) == 2 * 3
    assert all(case.scans.seed == case.seed and case.structure == str(STRUCTURE) for case in found)
    assert found[0].scans.name.startswith("climb_noise0.008_seed1_")


def test_given_folders_have_neither_noise_nor_a_structure_of_their_own(tmp_path):
    (tmp_path / "a").mkdir()
    (found,) = cases(tmp_path, "data: [a]\nmethods: [plane]\n")
    assert (found.scans.folder, found.scans.trajectory) == (str(tmp_path / "a"), None)
    assert (found.voxel_m, found.structure) == (None, None)


def test_whatever_differs_has_another_name(tmp_path):
    (tmp_path / "a").mkdir()
    base = "data: [a]\nmethods: [plane]\n"
    texts = [base, base + "refine: true\n", base + "set: [mapper.max_range_m=5]\n", base + "seeds: [2]\n"]
    texts += [base + "structure: structures/original.yaml\n", base.replace("plane", "gicp")]
    assert len({cases(tmp_path, text)[0].name for text in texts}) == len(texts)
    assert cases(tmp_path, base)[0].name == cases(tmp_path, base)[0].name


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("methods: [a]\n", "must have either data or simulate"),
        (
            "data: [.]\nsimulate: {trajectory: trajectories/climb.csv}\nmethods: [a]\n",
            "must have either data or simulate",
        ),
        ("data: [.]\nmethods: [a]\nrange_noise_m: [0.1]\n", "range_noise_m is of simulated scans"),
        ("data: [.]\nmethods: []\n", "methods: "),
        ("data: [.]\nmethods: [a]\nvoxels: [0]\n", "voxels.0: "),
        ("data: [.]\nmethods: [a]\nnoise: [0]\n", "noise: unknown key; known are data, simulate"),
        ("data: [absent]\nmethods: [a]\n", "absent: no such folder"),
        ("simulate: {trajectory: absent.csv}\nmethods: [a]\n", "simulate.trajectory: no such file: absent.csv"),
        ("data: [", "not valid YAML"),
        ("", "valid dictionary"),
    ],
)
def test_what_is_wrong_in_a_specification_is_said(tmp_path, text, reason):
    with pytest.raises(ConfigError, match=reason):
        cases(tmp_path, text)


class Told(Sweep):
    """Answers for the commands, and notes which were run."""

    def __init__(self, *arguments, failing=()):
        super().__init__(*arguments)
        self.said = []
        self.failing = failing

    def _hyrecro(self, arguments):
        self.said.append(arguments)
        if any(word in self.failing for word in arguments):
            raise HyrecroError("it broke")
        if arguments[0] == "simulate":
            Path(arguments[arguments.index("--out") + 1]).mkdir()
            return ""
        if arguments[0] == "map":
            return json.dumps({"lost_scans": 2, "ms_per_scan_p50": 1.25, "numbers": [1]})
        return json.dumps({"ate_rmse_m": 0.0015, "pairs_ok": 7, "num_pairs": 9})


@pytest.fixture
def scans(tmp_path):
    folder = tmp_path / "a"
    folder.mkdir()
    write_tum(folder / "truth.tum", [(0, SE3.identity())])
    return tmp_path


def test_cases_are_mapped_and_scored_once(scans):
    found = cases(scans, "data: [a]\nmethods: [gicp, plane]\nset: [mapper.max_range_m=5]\nrefine: true\n")
    sweep, lines = Told(found, scans / "out"), []
    sweep.run(2, lines.append)
    assert sweep.num_done == 2
    assert sorted(lines) == sorted(case.name for case in found)
    mapped = next(said for said in sweep.said if said[0] == "map" and "gicp" in said)
    assert mapped[1] == str(scans / "a")
    assert {"--refine", "mapper.max_range_m=5", "seed=1"} <= set(mapped)
    again = Told(found, scans / "out")
    again.run(2, lines.append)
    assert again.said == []
    assert [result["eval"]["ate_rmse_m"] for result in again.results()] == [0.0015, 0.0015]


def test_scans_are_made_once_for_all_methods(tmp_path):
    text = (
        "simulate: {trajectory: trajectories/climb.csv, num_scans: 9}\nmethods: [gicp, plane]\nrange_noise_m: [0.03]\n"
    )
    found = cases(tmp_path, text)
    sweep = Told(found, tmp_path / "out")
    sweep.run(2, lambda _: None)
    (made,) = [said for said in sweep.said if said[0] == "simulate"]
    assert made[made.index("--scans") + 1] == "9"
    assert made[-2:] == ["--set", "sensors.lidar.range_noise_m=0.03"]
    assert {said[1] for said in sweep.said if said[0] == "map"} == {
        str(tmp_path / "out" / "data" / found[0].scans.name)
    }
    assert not list((tmp_path / "out" / "data").glob("*.partial"))


def test_a_case_that_failed_is_told_kept_and_run_again(scans):
    found = cases(scans, "data: [a]\nmethods: [gicp, plane]\n")
    sweep, lines = Told(found, scans / "out", failing=("plane",)), []
    sweep.run(1, lines.append)
    assert sweep.num_done == 1
    assert any(line.endswith("failed: it broke") for line in lines)
    assert [result["error"] for result in sweep.results()] == [None, "it broke"]
    again = Told(found, scans / "out")
    again.run(1, lines.append)
    assert {said[0] for said in again.said} == {"map", "eval"}
    assert again.num_done == 2


def test_a_sweep_that_is_stopped_runs_nothing_more(scans):
    found = cases(scans, "data: [a]\nmethods: [gicp, plane]\n")
    sweep = Told(found, scans / "out", lambda: True)
    sweep.run(1, print)
    assert (sweep.said, sweep.results()) == ([], [])


def test_scans_without_truth_are_not_scored(tmp_path):
    (tmp_path / "a").mkdir()
    sweep = Told(cases(tmp_path, "data: [a]\nmethods: [gicp]\n"), tmp_path / "out")
    sweep.run(1, print)
    assert [said[0] for said in sweep.said] == ["map"]
    assert sweep.results()[0]["eval"] is None


def test_the_table(scans):
    found = cases(scans, "data: [a]\nmethods: [gicp, plane]\n")
    sweep = Told(found, scans / "out", failing=("plane",))
    sweep.run(1, lambda _: None)
    rows = rows_of(sweep.results())
    first, second = csv.DictReader(csv_text(rows).splitlines())
    assert (first["eval.ate_rmse_m"], first["map.ms_per_scan_p50"], first["error"]) == ("0.0015", "1.25", "")
    assert (second["method"], second["eval.ate_rmse_m"], second["error"]) == ("plane", "", "it broke")
    title, _, *lines = markdown_text(rows).splitlines()
    assert title == "| scans | method | seed | ATE [mm] | right steps | lost | ms a scan | error |"
    assert lines == ["| a | gicp | 1 | 1.50 | 7/9 | 2 | 1.2 |  |", "| a | plane | 1 |  |  |  |  | it broke |"]
