"""The page of settings: names, defaults and limits from the configuration's types, meanings from beside them."""

from __future__ import annotations

import ast
import enum
import inspect
import json
import textwrap
import types
import typing
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from shared.runtime.config import CONFIGS_DIR, Config
from shared.runtime.section import Section
from shared.runtime.sensor_config import PRESETS_DIR, MountConfig, SensorConfig
from tools.docs.markdown import code, page, table

_INTRODUCTION = """Built-in values come first, then a file (`--config FILE`, or the name of a preset in `configs/`), the
environment (`HYRECRO_MAPPER__VOXEL_SIZE_M=0.1`), and last the command line (`--set mapper.voxel_size_m=0.1`). A file
states only what differs. `configs/default.yaml` has all of them; `hyrecro config show` prints what results,
`hyrecro config check` names every problem at once. Names end in their units.

"""
_PRESETS = ("ideal", "original", "datasheet")
_LIMITS = {"gt": "> {}", "ge": "≥ {}", "lt": "< {}", "le": "≤ {}"}


def settings_page() -> str:
    """The whole page, a section of the configuration a heading."""
    comments = YAML().load((CONFIGS_DIR / "default.yaml").read_text(encoding="utf-8"))
    return page("Settings", _INTRODUCTION, *_sections(Config, "", comments))


def _sections(section: type[Section], path: str, comments: CommentedMap) -> Iterator[str]:
    yield f"{'' if not path else chr(10)}## {path or 'Top'}\n\n{inspect.cleandoc(section.__doc__ or '')}\n\n"
    plain = {name: field for name, field in section.model_fields.items() if _section_of(field) is None}
    shipped = {name: field for name, field in plain.items() if not field.is_required()}
    rows = ([code(name), *_cells(section, name, field, comments)] for name, field in shipped.items())
    if shipped:
        yield table(["setting", "default", "allowed", "meaning"], rows)
    if issubclass(section, SensorConfig):
        yield from _preset_tables(section)
        return
    for name, field in section.model_fields.items():
        if (below := _section_of(field)) is not None:
            yield from _sections(below, f"{path}.{name}" if path else name, comments.get(name, CommentedMap()))


def _cells(section: type[Section], name: str, field: FieldInfo, comments: CommentedMap) -> list[str]:
    is_choice = typing.get_origin(field.annotation) is typing.Literal  # its comment only lists the choices
    meaning = _attribute_docs(section).get(name) or ("" if is_choice else _comment(comments, name))
    default = field.get_default(call_default_factory=True, validated_data={})
    return [code(_shown(default)), _allowed(field), meaning]


def _preset_tables(section: type[SensorConfig]) -> Iterator[str]:
    """What the presets state, side by side."""
    presets = [YAML(typ="safe").load(PRESETS_DIR / f"{section.KIND}_{name}.yaml") for name in _PRESETS]
    yield "\nThe preset states the rest:\n\n"
    yield table(["setting", *_PRESETS, "allowed", "meaning"], _preset_rows(section, presets, ""))


def _preset_rows(section: type[Section], presets: list[Any], prefix: str) -> Iterator[list[str]]:
    for name, field in section.model_fields.items():
        if not field.is_required():
            continue
        values = [preset[name] for preset in presets]
        if (below := _section_of(field)) is not None:
            yield from _preset_rows(below, values, f"{prefix}{name}.")
            continue
        meaning = _attribute_docs(section).get(name, "")
        yield [code(prefix + name), *(code(_shown(value)) for value in values), _allowed(field), meaning]


def _section_of(field: FieldInfo) -> type[Section] | None:
    kind = field.annotation
    return kind if isinstance(kind, type) and issubclass(kind, Section) else None


def _allowed(field: FieldInfo) -> str:
    hint = field.annotation
    limits = [(mark, name) for mark in field.metadata for name in _LIMITS if hasattr(mark, name)]
    parts = [_LIMITS[name].format(getattr(mark, name)) for mark, name in limits]
    options = [hint, *typing.get_args(hint)] if isinstance(hint, types.UnionType) else [hint]
    for option in options:
        if typing.get_origin(option) is typing.Literal:
            parts += [code(str(choice)) for choice in typing.get_args(option)]
        elif option is bool:
            parts += ["`true`", "`false`"]
        elif option is MountConfig:
            parts.append("`{parent, xyz_m, rpy_deg}`")
        elif isinstance(option, type) and issubclass(option, enum.Enum):
            parts += [code(str(choice.value)) for choice in option]
        elif isinstance(option, type) and issubclass(option, Path):
            parts.append("a file" if field.metadata else "a folder")
    if type(None) in options:
        parts.append("`null`")
    return ", ".join(parts)


def _shown(value: Any) -> str:
    if value is PydanticUndefined:
        return ""
    if isinstance(value, enum.Enum):
        return str(value.value)
    return str(value) if isinstance(value, Path | str) and str(value) else json.dumps(value)


def _comment(comments: CommentedMap, name: str) -> str:
    """What stands behind the setting in default.yaml, as a sentence."""
    tokens = comments.ca.items.get(name, [])
    text = next((str(token.value).strip() for token in tokens[2:3] if token is not None), "")
    line = text.partition("\n")[0].lstrip("# ")
    return f"{line[:1].upper()}{line[1:]}." if line else ""


@cache
def _attribute_docs(section: type[Section]) -> dict[str, str]:
    """The string below each setting in the code, of its bases too."""
    docs: dict[str, str] = {}
    for kind in reversed(section.__mro__):
        if issubclass(kind, Section) and kind is not Section:
            (body,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
            assert isinstance(body, ast.ClassDef)
            for before, after in zip(body.body, body.body[1:], strict=False):
                if isinstance(before, ast.AnnAssign) and isinstance(after, ast.Expr):
                    docs[ast.unparse(before.target)] = str(ast.literal_eval(after.value))
    return docs
