"""A sweep by the production command."""

import numpy as np
import pytest

from shared.cloud_files import write_cloud
from tests.support.processes import run

pytestmark = pytest.mark.e2e


def test_a_case_that_cannot_be_mapped_is_told_and_the_table_written(tmp_path):
    """A folder with one cloud, which is cut off."""
    (tmp_path / "a").mkdir()
    write_cloud(tmp_path / "a" / "data0.pcd", np.ones((4, 3)))
    (tmp_path / "a" / "data0.pcd").write_bytes((tmp_path / "a" / "data0.pcd").read_bytes()[:-3])
    (tmp_path / "s.yaml").write_text("data: [a]\nmethods: [gicp]\n")
    result = run("hyrecro", "sweep", tmp_path / "s.yaml", "--out", tmp_path / "out")
    assert (result.returncode, result.stdout.splitlines()[-1]) == (3, f"0 of 1 cases in {tmp_path / 'out'}")
    assert "failed: " in result.stderr
    assert "| gicp |" in (tmp_path / "out" / "results.md").read_text()
