"""Loads the configuration: built-in defaults < file < environment < flags. Every problem is reported, at once."""

from __future__ import annotations

import difflib
import typing
from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from ruamel.yaml import YAML

from shared.errors import ConfigError, InputFileError
from shared.files import read_text
from shared.runtime.config import CONFIGS_DIR, Config
from shared.yaml_reading import YamlError, load_yaml

ENVIRONMENT_PREFIX = "HYRECRO_"
ENVIRONMENT_SEPARATOR = "__"
DEFAULT_CONFIG = CONFIGS_DIR / "default.yaml"

Origins = dict[tuple[str, ...], str]


def load_config(
    path: Path = DEFAULT_CONFIG, overrides: Sequence[str] = (), environ: Mapping[str, str] | None = None
) -> Config:
    """The configuration of a file, changed by environment variables and `section.key=value` overrides.

    A bare preset name such as `original` stands for `configs/original.yaml`. In the environment `mapper.method` is
    `HYRECRO_MAPPER__METHOD`. Values are read as YAML.

    Raises:
        ConfigError: with one line for each problem: origin, key, rule, value.
    """
    path = _resolve_preset(path)
    tree = _read_yaml(path)
    problems: list[str] = []
    origins: Origins = {}
    for name, text in sorted((_printable(name), _printable(text)) for name, text in (environ or {}).items()):
        if name.startswith(ENVIRONMENT_PREFIX):
            keys = name.removeprefix(ENVIRONMENT_PREFIX).lower().split(ENVIRONMENT_SEPARATOR)
            _set(tree, keys, text, f"environment {name}", origins, problems)
    for override in map(_printable, overrides):
        dotted, equals, text = override.partition("=")
        if not equals:
            problems.append(f"--set {override}: must be section.key=value")
            continue
        _set(tree, dotted.split("."), text, "--set", origins, problems)
    try:
        config = Config.model_validate(tree, context={"base_dir": path.resolve().parent})
    except ValidationError as error:
        problems += [_problem_text(path, dict(details), origins) for details in error.errors()]
    if problems:
        raise ConfigError(problems)
    return config


def _printable(text: str) -> str:
    """Bytes of the command line that are not UTF-8, as escapes: they are quoted in errors."""
    return text.encode(errors="backslashreplace").decode()


def dump_config(config: Config) -> str:
    """The resolved configuration as YAML, as it is stored in recordings and shown by `hyrecro config show`."""
    out = StringIO()
    yaml = YAML()
    yaml.default_flow_style = False
    yaml.dump(config.model_dump(mode="json"), out)
    return out.getvalue()


def _resolve_preset(path: Path) -> Path:
    preset = CONFIGS_DIR / f"{path}.yaml"
    path = preset if len(path.parts) == 1 and not path.suffix and not path.exists() and preset.is_file() else path
    absolute = path.absolute()
    return absolute.relative_to(Path.cwd()) if absolute.is_relative_to(Path.cwd()) else path


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        tree = load_yaml(read_text(path), str(path))
    except InputFileError as error:
        presets = ", ".join(sorted(preset.stem for preset in CONFIGS_DIR.glob("*.yaml")))
        raise ConfigError([f"{error}; presets are {presets}"]) from error
    except YamlError as error:
        raise ConfigError([str(error)]) from error
    if tree is None:
        return {}
    if not isinstance(tree, dict):
        raise ConfigError([f"{path}: must be a map of sections, got {type(tree).__name__}"])
    return tree


def _set(
    tree: dict[str, Any], keys: Sequence[str], text: str, origin: str, origins: Origins, problems: list[str]
) -> None:
    try:
        value = load_yaml(text, origin) if text else ""
    except YamlError:
        problems.append(f"{origin}: {'.'.join(keys)}: {_shortened(text)} is not a YAML value")
        return
    node = tree
    for key in keys[:-1]:
        child = node.setdefault(key, {})
        if not isinstance(child, dict):
            problems.append(f"{origin}: {'.'.join(keys)}: {key} is not a section")
            return
        node = child
    node[keys[-1]] = value
    origins[tuple(keys)] = origin


def _problem_text(path: Path, details: Mapping[str, Any], origins: Origins) -> str:
    location = tuple(str(part) for part in details["loc"])
    origin = str(path)
    for keys, name in origins.items():  # a rule of a whole section may be broken by a setting in it
        if location[: len(keys)] == keys[: len(location)]:
            origin = name
            break
    if details["type"] == "extra_forbidden":
        known = _keys_of_section(location[:-1])
        near = difflib.get_close_matches(location[-1], known, n=1)
        rule = f"unknown key, did you mean {near[0]}?" if near else f"unknown key; known are {', '.join(known)}"
        return f"{origin}: {'.'.join(location)}: {rule}"
    rule = str(details["msg"]).removeprefix("Value error, ").removeprefix("Input ")
    shown = "" if details["type"] in ("value_error", "missing") else f", got {_shortened(details['input'])}"
    return f"{origin}: {'.'.join(location) or 'configuration'}: {rule}{shown}"


def _shortened(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _keys_of_section(location: Sequence[str]) -> list[str]:
    section: type[BaseModel] = Config
    for key in location:
        annotation = section.model_fields[key].annotation if key in section.model_fields else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return []
        section = annotation
    return typing.cast("list[str]", list(section.model_fields))
