"""Every configuration file is usable; every mistake is named, all at once."""

from pathlib import Path

import pytest
from ruamel.yaml import YAML

from shared.errors import ConfigError
from shared.runtime.config import CONFIGS_DIR, Config
from shared.runtime.config_loading import dump_config, load_config
from shared.runtime.sensor_config import PRESETS_DIR, DepthConfig, ImuConfig, LidarConfig, SurfaceConfig

PRESETS = sorted(CONFIGS_DIR.glob("*.yaml"))
SENSORS = {"lidar": LidarConfig, "depth": DepthConfig}
SENSOR_PRESETS = sorted(PRESETS_DIR.glob("*.yaml"))
BEAM_TABLES = sorted((PRESETS_DIR / "beams").glob("*.yaml"))


def required(section):
    """The settings that have no default in the code."""
    return {name for name, field in section.model_fields.items() if field.is_required()}


def read_yaml(path):
    return YAML(typ="safe").load(path)


@pytest.mark.parametrize("path", PRESETS, ids=lambda path: path.stem)
def test_each_preset_is_usable(path):
    assert load_config(path) == load_config(path.relative_to(CONFIGS_DIR).with_suffix(""))


def test_the_default_file_states_every_default():
    assert load_config() == Config.model_validate({})
    text = (CONFIGS_DIR / "default.yaml").read_text()
    defaults = Config.model_validate({}).model_dump()
    for kind, sensor in SENSORS.items():
        for name in required(sensor):
            del defaults["sensors"][kind][name]  # a preset states it
    missing = [name for name in _leaf_names(defaults) if f"{name}:" not in text]
    assert missing == []


def _leaf_names(tree):
    for name, value in tree.items():
        yield name
        if isinstance(value, dict):
            yield from _leaf_names(value)


@pytest.mark.parametrize("kind", SENSORS)
def test_each_kind_of_sensor_has_the_three_presets(kind):
    names = {path.stem.removeprefix(f"{kind}_") for path in SENSOR_PRESETS if path.stem.startswith(kind)}
    assert names == {"ideal", "original", "datasheet"}


@pytest.mark.parametrize("path", SENSOR_PRESETS, ids=lambda path: path.stem)
def test_each_preset_of_a_sensor_states_every_setting_that_is_the_preset_s(path):
    kind, _, name = path.stem.partition("_")
    section, settings = SENSORS[kind], read_yaml(path)
    assert set(settings) == required(section)
    assert set(settings["imu"]) == set(ImuConfig.model_fields)
    for surface in settings.get("surfaces", {}).values():
        assert set(surface) == set(SurfaceConfig.model_fields)
    assert load_config(overrides=[f"sensors.{kind}.preset={name}"]).sensors.named()[kind].preset == path
    assert section.model_validate({"preset": path}).rate_hz > 0


@pytest.mark.parametrize("path", BEAM_TABLES, ids=lambda path: path.stem)
def test_each_table_of_beams_has_128_rows(path):
    table = read_yaml(path)
    elevations, azimuths = table["elevations_deg"], table["azimuths_deg"]
    assert (len(elevations), len(azimuths)) == (128, 128)
    assert elevations == sorted(elevations, reverse=True), "top to bottom"
    assert -45 < elevations[-1] < elevations[0] < 45
    assert max(map(abs, azimuths)) < 10


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
