"""The code in the tutorials does what they say."""

import re
from pathlib import Path

import numpy as np
import pytest

from services.mapper.methods.registry import registration_class
from services.mapper.point_matcher import PointMatcher
from shared.geometry import SE3
from shared.runtime.config import MapperConfig
from tests.support.steel_clouds import steel_cloud

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorials" / "your_own_method.md"
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
