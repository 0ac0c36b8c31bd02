"""Reads YAML: what is malformed, or small and would become large, is one error that says where."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent, ScalarEvent

MAX_DEPTH = 100
"""Of brackets in brackets."""
MAX_NODES = 1_000_000
"""Values, lists and maps, those counted again that an alias (`*name`) repeats."""


class YamlError(ValueError):
    """What is wrong with a document: its name, where known the line, and the reason."""


def load_yaml(text: str, source: str) -> Any:
    """The value of a YAML document; `source` names it in errors.

    Raises:
        YamlError: not YAML, nested too deeply, or more than `MAX_NODES` once its aliases are resolved.
    """
    try:
        _check_depth(text)
        if "&" in text:
            _check_aliases(text)
        return YAML(typ="safe", pure=True).load(text)
    except RecursionError:
        raise YamlError(f"{source}: not valid YAML: lists or maps are nested too deeply") from None
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f":{mark.line + 1}" if mark is not None else ""
        raise YamlError(f"{source}{place}: not valid YAML: {getattr(error, 'problem', None) or error}") from error
    except Exception as error:  # the library raises what int, float and datetime raise, and more
        raise YamlError(f"{source}: not valid YAML: {error or type(error).__name__}") from error


def _check_depth(text: str) -> None:
    """Counts brackets, those in quotes too: the library takes minutes to find that some thousands are not closed."""
    depth = 0
    for bracket in re.finditer(r"[\[\]{}]", text):
        depth = depth + 1 if bracket[0] in "[{" else max(depth - 1, 0)
        if depth > MAX_DEPTH:
            raise RecursionError


def _check_aliases(text: str) -> None:
    """Counts what the aliases stand for, without building it: ten lines may mean a billion values."""
    sizes: Counter[str | None] = Counter()
    open_names: list[str | None] = [None]
    open_sizes = [0]
    for event in YAML(typ="safe", pure=True).parse(text):
        if isinstance(event, CollectionStartEvent):
            open_names.append(event.anchor)
            open_sizes.append(1)
        elif isinstance(event, AliasEvent):
            if event.anchor in open_names:
                raise ValueError(f"*{event.anchor} stands in itself")
            open_sizes[-1] += sizes[event.anchor]
        elif isinstance(event, ScalarEvent):
            open_sizes[-1] += 1
            sizes[event.anchor] = 1
        elif isinstance(event, CollectionEndEvent):
            name, size = open_names.pop(), open_sizes.pop()
            sizes[name] = size
            open_sizes[-1] += size
        if open_sizes[-1] > MAX_NODES:
            raise ValueError(f"its aliases make more than {MAX_NODES} values of it")
