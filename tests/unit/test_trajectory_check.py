import json

import pytest
from typer.testing import CliRunner

from cli.main import app
from shared.errors import InputFileError
from shared.runtime.exit_codes import Exit

HEADER = "q1,q2,q3,q4,q5,q6,q7,q8\n"
CHANGE = "C,C,C,C,C,C,C,C\n"
STEP = "-0.6,0,0.6,0,0,0.6,0,-0.6\n"
"""The foot slides along the bar, and stands flush."""
INTO_BAR = "-0.3,0,0,0,0,0,0,0\n"


def check(tmp_path, text, *arguments):
    path = tmp_path / "moves.csv"
    path.write_text(text)
    return CliRunner().invoke(app, ["robot", "check", str(path), *arguments])


def test_a_good_trajectory_has_a_line_a_row_and_ends_with_0(tmp_path):
    result = check(tmp_path, HEADER + STEP + CHANGE)
    lines = result.stdout.splitlines()
    assert result.exit_code == Exit.FINE
    assert [line.split()[:3] for line in lines[1:4]] == [["start", "on", "A"], ["2", "move", "B"], ["3", "fix", "B"]]
    assert all(line.endswith("fine") for line in lines[1:])
    assert lines[4].startswith(
        "1 moves, 1 landings; deepest cut 0.00 mm; worst landing 0.00 mm, 0.00 deg; least holding"
    )


def test_a_bad_row_is_named_and_ends_with_3(tmp_path):
    result = check(tmp_path, HEADER + INTO_BAR + STEP)
    lines = result.stdout.splitlines()
    assert result.exit_code == Exit.PARTIAL
    assert "BAD: foot_b cuts " in lines[2]
    assert " mm into beam_y_2 at 100 % of the way" in lines[2]
    assert lines[-1].endswith("2 rows are BAD")


def test_json_has_the_same(tmp_path):
    result = check(tmp_path, HEADER + INTO_BAR + CHANGE, "--json")
    report = json.loads(result.stdout)
    assert result.exit_code == Exit.PARTIAL
    start, move, change = report["rows"]
    assert (start["kind"], move["line"], change["kind"]) == ("start", 2, "change")
    assert move["cut"]["link"] == "foot_b"
    assert move["cut"]["depth_mm"] == pytest.approx(report["summary"]["max_depth_mm"])
    assert start["landing"]["members"] == ["beam_y_2"]


def test_the_start_and_the_structure_are_the_configurations(tmp_path):
    result = check(tmp_path, HEADER + STEP, "--set", "sim.initial_foot_xyz_m=[0, -0.775, 10.605]")
    assert result.exit_code == Exit.PARTIAL
    assert "foot A ends 500 mm from any steel" in result.stdout
    assert "landings in the air" in result.stdout


def test_an_unusable_file_is_an_input_error(tmp_path):
    result = check(tmp_path, "rubbish\n")
    assert isinstance(result.exception, InputFileError)  # `main` makes exit code 2 of it


def test_a_file_in_degrees_is_told_as_beyond_the_limits(tmp_path):
    result = check(tmp_path, HEADER + "34000,0,34,0,0,34,0,-34\n")
    assert "q1 is 34000 rad, must be within -1.5708..1.5708 rad" in result.stdout
