"""Every climb that is shipped passes the check, from where the default configuration starts."""

import pytest

from cli.trajectory_check import check_trajectory, summary
from shared.runtime.config import CONFIGS_DIR
from shared.runtime.config_loading import load_config

CLIMBS = sorted((CONFIGS_DIR / "trajectories").glob("*.csv"))
README = (CONFIGS_DIR / "trajectories" / "README.md").read_text()


@pytest.mark.parametrize("path", CLIMBS, ids=lambda path: path.stem)
def test_each_climb_passes_the_check_and_is_described(path):
    reports = check_trajectory(path, load_config())
    assert [(report.line, report.problems) for report in reports if report.problems] == []
    figures = summary(reports)
    assert figures["num_landings_in_the_air"] == 0
    row = next(line for line in README.splitlines() if f"`{path.name}`" in line)
    cells = [cell.strip() for cell in row.split("|")]
    assert cells[3:6] == [str(figures["num_landings"]), str(figures["num_moves"]), f"{figures['min_margin']:.2f}"]
