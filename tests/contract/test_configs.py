"""Every configuration file is usable; every mistake is named, all at once."""

from pathlib import Path

import pytest

from shared.errors import ConfigError
from shared.runtime.config import CONFIGS_DIR, Config
from shared.runtime.config_loading import dump_config, load_config

PRESETS = sorted(CONFIGS_DIR.glob("*.yaml"))


@pytest.mark.parametrize("path", PRESETS, ids=lambda path: path.stem)
def test_each_preset_is_usable(path):
    assert load_config(path) == load_config(path.relative_to(CONFIGS_DIR).with_suffix(""))


def test_the_default_file_states_every_default():
    assert load_config() == Config.model_validate({})
    text = (CONFIGS_DIR / "default.yaml").read_text()
    missing = [name for name in _leaf_names(Config.model_validate({}).model_dump()) if f"{name}:" not in text]
    assert missing == []


def _leaf_names(tree):
    for name, value in tree.items():
        yield name
        if isinstance(value, dict):
            yield from _leaf_names(value)


def test_what_is_dumped_loads_again(tmp_path):
    path = tmp_path / "resolved.yaml"
    config = load_config(overrides=["mapper.voxel_size_m=0.07"])
    path.write_text(dump_config(config))
    assert load_config(path) == config
    assert config.mapper.voxel_size_m == 0.07


def test_one_message_names_every_problem(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("mapper: {voxel_sise_m: 0.1, num_threads: 0}\nstructure: nowhere.yaml\n")
    with pytest.raises(ConfigError) as caught:
        load_config(path, ["sensors.lidar.min_range_m=20"], {"HYRECRO_BUS__ENDPOINT": "nonsense"})
    text = str(caught.value)
    assert len(caught.value.problems) == 5
    assert f"{path}: mapper.voxel_sise_m: unknown key, did you mean voxel_size_m?" in text
    assert f"{path}: mapper.num_threads: should be greater than or equal to 1, got 0" in text
    assert f"{path}: structure: no such file: nowhere.yaml" in text
    assert "sensors.lidar: min_range_m 20.0 must be below max_range_m 10.0" in text
    assert "environment HYRECRO_BUS__ENDPOINT: bus.endpoint: " in text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("- 1\n- 2\n", "must be a map of sections"),
        ("seed: [1\n", "not valid YAML"),
        ("seed: 1\nseed: 2\n", "not valid YAML"),
        ("seed: .nan\n", "seed: "),
        ("sim: 3\n", "sim: "),
        ("\x00", "not valid YAML"),
    ],
)
def test_files_that_are_no_configuration(tmp_path, text, expected):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=expected):
        load_config(path)


def test_a_missing_file_lists_the_presets():
    with pytest.raises(ConfigError, match=r"nowhere.*presets are default, original"):
        load_config(Path("nowhere"))


def test_precedence_is_file_then_environment_then_flag(tmp_path):
    path = tmp_path / "some.yaml"
    path.write_text("seed: 2\n")
    assert load_config(path).seed == 2
    assert load_config(path, environ={"HYRECRO_SEED": "3"}).seed == 3
    assert load_config(path, ["seed=4"], {"HYRECRO_SEED": "3"}).seed == 4
