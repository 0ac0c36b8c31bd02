from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from shared.errors import ConfigError, InputFileError
from shared.geometry import SE3
from shared.robot.urdf import parse_urdf
from shared.runtime.config import CONFIGS_DIR
from shared.solids import Box
from shared.world.files import load_structure
from shared.world.structure import Member, Structure
from shared.world.urdf_format import structure_urdf

ORIGINAL = CONFIGS_DIR / "structures" / "original.yaml"


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "structure.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_original_has_its_21_bars():
    structure = load_structure(ORIGINAL)
    boxes = {(tuple(bar.T_world_member.translation.tolist()), bar.solid.size_m) for bar in structure.members}
    expected = {((x, y, 10.0), (0.2, 0.2, 4.0)) for x in (-1.9, 0.0, 1.9) for y in (-2.1, 0.0, 2.1)}
    expected |= {((0.0, y, z), (4.0, 0.2, 0.2)) for y in (-2.1, 0.0, 2.1) for z in (10.0, 11.9)}
    expected |= {((x, 0.0, z), (0.2, 4.0, 0.2)) for x in (-1.9, 0.0, 1.9) for z in (10.0, 11.9)}
    assert len(structure.members) == 21
    assert boxes == expected
    assert structure.ground_z_m == 0.0


def test_a_bar_may_be_turned(tmp_path):
    text = "name: s\nbars:\n- {name: b, centre_m: [1, 2, 3], size_m: [0.1, 0.2, 4], rpy_deg: [0, 90, 0]}\n"
    structure = load_structure(written(tmp_path, text))
    (bar,) = structure.members
    assert structure.ground_z_m is None
    np.testing.assert_allclose(bar.T_world_member.apply(np.array([0.0, 0.0, 2.0])), [3, 2, 3], atol=1e-15)


def test_the_ground_is_a_box_below_its_height_around_the_bars():
    bar = Member("b", Box((2.0, 3.0, 6.0)), SE3.trans(x_m=10.0))  # half its diagonal is 3.5 m
    _, ground = parse_urdf(structure_urdf(Structure("s", (bar,), ground_z_m=-1.5)), "urdf").shapes
    assert ground.solid == Box((27.0, 27.0, 0.1))
    np.testing.assert_allclose(ground.T_link_shape.translation, [10, 0, -1.55])


angles = st.one_of(st.floats(-np.pi, np.pi), st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi]))


@given(st.tuples(angles, angles, angles), st.tuples(*[st.floats(-100, 100)] * 3))
def test_urdf_says_where_each_bar_is(rpy_rad, centre_m):
    bar = Member("b", Box((0.1, 0.2, 0.3)), SE3.from_rpy(rpy_rad, centre_m))
    model = parse_urdf(structure_urdf(Structure("s", (bar,), None)), "urdf")
    (shape,) = model.shapes
    assert (model.root, shape.link, shape.solid) == ("world", "world", bar.solid)
    np.testing.assert_allclose(shape.T_link_shape.matrix, bar.T_world_member.matrix, rtol=0, atol=1e-14)


def test_every_problem_is_reported(tmp_path):
    text = """
nam: s
bars:
- {name: b, centre_m: [1, 2], size_m: [0.1, 0.2, 4]}
- {name: b, centre_m: [1, 2, .inf], size_m: [0.1, -0.2, thick]}
- {name: "a b", centre_m: [1, 2, 3], size_m: [0.1, 0.2, 4], colour: red}
"""
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_structure(path)
    assert sorted(caught.value.problems) == [
        f"{path}: bars[0].centre_m[2]: Field required",
        f"{path}: bars[1].centre_m[2]: should be a finite number, got inf",
        f"{path}: bars[1].size_m[1]: should be greater than 0, got -0.2",
        f"{path}: bars[1].size_m[2]: should be a valid number, unable to parse string as a number, got 'thick'",
        f"{path}: bars[2].colour: unknown key",
        f"{path}: bars[2].name: String should match pattern '^[A-Za-z0-9_.-]+$', got 'a b'",
        f"{path}: nam: unknown key",
        f"{path}: name: Field required",
    ]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "structure.yaml: document: "),
        ("name: s\nbars: []\n", "bars: List should have at least 1 item"),
        (
            "name: s\nbars:\n- &b {name: b, centre_m: [0, 0, 0], size_m: [1, 1, 1]}\n- *b\n",
            "structure.yaml: bar 'b': defined 2 times",
        ),
    ],
)
def test_unusable_content_is_refused(tmp_path, text, reason):
    with pytest.raises(ConfigError) as caught:
        load_structure(written(tmp_path, text))
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("name: s\nname: t\n", ':2: not valid YAML: found duplicate key "name"'),
        ("name: [\n", ":2: not valid YAML"),
    ],
)
def test_what_is_not_yaml_is_refused(tmp_path, text, reason):
    with pytest.raises(InputFileError) as caught:
        load_structure(written(tmp_path, text))
    assert reason in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputFileError, match=r"absent\.yaml: No such file"):
        load_structure(tmp_path / "absent.yaml")
