"""The code in the tutorials does what they say."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from services.mapper.methods.registry import registration_class
from services.mapper.point_matcher import PointMatcher
from shared.geometry import SE3
from shared.runtime.config import MapperConfig
from tests.support.scans import NUM_SCANS
from tests.support.steel_clouds import steel_cloud

DOCS = Path(__file__).parents[2] / "docs"
TUTORIAL = DOCS / "tutorials" / "your_own_method.md"
CONFIG = MapperConfig(min_range_m=0.0)


@pytest.fixture
def own_method(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)
    (file,) = re.findall(r"Save it as `(\w+\.py)`", TUTORIAL.read_text(encoding="utf-8"))
    (name,) = re.findall(r"^class (\w+)", code, re.MULTILINE)
    (tmp_path / file).write_text(code, encoding="utf-8")
    assert f"`mapper.method: {file}:{name}`" in TUTORIAL.read_text(encoding="utf-8")
    return registration_class(f"{tmp_path / file}:{name}")


def test_a_method_of_ones_own_finds_a_scan(own_method):
    T_map_lidar = SE3.trans(0.04, -0.03, 0.02) @ SE3.exp([0, 0, 0, 0.03, -0.02, 0.04])
    matcher = PointMatcher(CONFIG, own_method)
    matcher.start(steel_cloud(1), SE3.identity())
    result = matcher.align(T_map_lidar.inv().apply(steel_cloud(2)), [SE3.identity()], 1.0)
    error = T_map_lidar.inv() @ result.T_map_lidar
    assert np.linalg.norm(error.translation) < 0.01
    assert error.angle_rad < 0.01
    assert result.score > CONFIG.min_score
    matcher.accept(result.T_map_lidar)


def test_a_method_of_ones_own_claims_nothing_without_overlap(own_method):
    assert own_method(steel_cloud(1), CONFIG).align(steel_cloud(2) + 90.0, SE3.identity(), 0.1).score == 0.0


def test_the_command_of_the_tutorial_maps_with_it(own_method, recorded_scans, tmp_path):
    (words,) = re.findall(r"^hyrecro (map .*)$", TUTORIAL.read_text(encoding="utf-8"), re.MULTILINE)
    shutil.copytree(recorded_scans[0], tmp_path / "scans")
    hyrecro = [sys.executable, "-m", "cli.main", *words.split(), "--json"]
    ran = subprocess.run(hyrecro, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    figures = json.loads(ran.stdout)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert (figures["method"], figures["scans"], figures["lost_scans"]) == ("my_icp.py:MyIcp", NUM_SCANS, 0)


def test_the_program_in_the_docs_of_mapping_runs(recorded_scans, tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", (DOCS / "mapping.md").read_text(encoding="utf-8"), re.DOTALL)
    shutil.copytree(recorded_scans[0], tmp_path / "scans")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "mapping.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" [")[0] for line in lines[:-1]] == [str(number) for number in range(NUM_SCANS)]
    assert re.fullmatch(r"\(\d{4,}, 3\) \d+", lines[-1])
