"""The page of keys and messages, from the channel table and the messages themselves."""

from __future__ import annotations

import dataclasses
import inspect
import re
from typing import Any

from shared.messaging.channels import CHANNELS
from shared.messaging.fields import FieldSpec, shape_text, specs_of
from shared.messaging.messages import Measurement, Message
from tools.docs.keys import linked_channel_table
from tools.docs.markdown import code, page, table

_INTRODUCTION = """All keys stand below `hyrecro/`; `bus.namespace` puts a name before that, for several robots. A
second sensor of a kind has keys of its own: `lidar_rear/points` beside `lidar/points`.

LATEST: who publishes drops rather than waits, who subscribes keeps the newest two. EVERY: nothing is left out; queues
are bounded, and an overflow is counted. A *kept* channel answers queries with its last message.

On the wire a message is a MessagePack map with the fields below. Arrays written as *list* travel as lists of numbers,
the others as little-endian bytes (*bin*). A command may come as JSON text, or bare where it says so.

"""
_MEASURED = """## Measurements

Everything but commands carries these three too: the simulated time at which it was measured, from 0 to 2^31 s; its
number, which counts up by one a message of one publisher; and what its coordinates refer to.

"""
_UNITS = {
    "_m": "m",
    "_mm": "mm",
    "_s": "s",
    "_ns": "ns",
    "_ms": "ms",
    "_hz": "Hz",
    "_rad": "rad",
    "_radps": "rad/s",
    "_mps2": "m/s²",
    "_n": "N",
    "_bytes": "bytes",
}
_POSE_UNIT = "m; quaternion x y z w"
_UNITS_OF_NAMES = {
    "q": "rad; m for q2, q7",
    "dq": "rad/s; m/s for q2, q7",
    "effort": "Nm; N for q2, q7",
    "positions": "m; rad for th_a, th_b",
    "velocities": "m/s; rad/s for th_a, th_b",
    "wrench": "N, then Nm",
    "coefficients": "1; the last m",
    "fitness": "m²",
    **dict.fromkeys(("fx", "fy", "cx", "cy"), "px"),
    **dict.fromkeys(("T_world_foot", "T_world_goal", "T_parent_child", "T_frame_child"), _POSE_UNIT),
}
_KINDS: dict[type, str] = {int: "whole number", float: "number", str: "text", bool: "true or false"}


def messages_page() -> str:
    """The whole page."""
    parts = [_INTRODUCTION, "## Keys\n\n", linked_channel_table(), "\n", _MEASURED]
    parts.append(_field_table(Measurement))
    parts += [part for message in _messages() for part in _section(message)]
    return page("Keys and messages", *parts)


def _messages() -> list[type[Message]]:
    """In the order of the channels; what a message is made of follows it."""
    found: dict[type[Message], None] = {}
    for channel in CHANNELS:
        found[channel.message] = None
        for spec in specs_of(channel.message):
            if spec.item is not None and spec.item.message is not None:
                found[spec.item.message] = None
    return list(found)


def _section(message: type[Message]) -> list[str]:
    keys = ", ".join(code(channel.key) for channel in CHANNELS if channel.message is message)
    parts = [f"\n## {message.__name__}\n\n", f"On {keys}. " if keys else "", _text_of(message, _fields(message))]
    if message.SHORTHAND is not None:
        parts.append(f"\nA bare value stands for `{message.SHORTHAND}`.\n")
    return [*parts, "\n", _field_table(message)]


def _fields(message: type[Message]) -> list[FieldSpec]:
    common = {spec.name for spec in specs_of(Measurement)} if message is not Measurement else set()
    own = issubclass(message, Measurement)
    return [spec for spec in specs_of(message) if not (own and spec.name in common)]


def _text_of(message: type[Message], fields: list[FieldSpec]) -> str:
    """The docstring as prose, names of fields as code; what it raises is what is refused."""
    text = inspect.cleandoc(message.__doc__ or "")
    text, _, refused = text.partition("\n\nRaises:")
    names = "|".join(re.escape(spec.name) for spec in fields)
    if names:
        text = re.sub(rf"(?<![\w`])({names})(?=(?: \([^)]*\))?[:,])", r"`\1`", text)
    if refused:
        text += "\n\nRefused: " + re.sub(r"^\s*\w+Error: ", "", refused)
    return text + "\n"


def _field_table(message: type[Message]) -> str:
    fields = _fields(message)
    if not fields:
        return ""
    defaults = {field.name: field.default for field in dataclasses.fields(message)}  # type: ignore[arg-type]
    rows = ([code(spec.name), _type(spec), _unit(spec.name), _default(defaults[spec.name])] for spec in fields)
    return table(["field", "type", "unit", "if left out"], rows)


def _type(spec: FieldSpec) -> str:
    if spec.array is not None:
        form = "list" if spec.array.is_inline else "bin"
        text = f"{form} of {spec.array.dtype} {shape_text(spec.array)}"
    elif spec.item is not None:
        text = f"list of {_type(spec.item)}"
    elif spec.message is not None:
        text = f"[{spec.message.__name__}](#{spec.message.__name__.lower()})"
    elif spec.choices is not None:
        text = " ".join(code(str(choice.value)) for choice in spec.choices)
    else:
        assert spec.kind is not None
        text = _KINDS[spec.kind]
    return text + (", or none" if spec.is_optional else "")


def _unit(name: str) -> str:
    suffix = "_" + name.rpartition("_")[2]
    return _UNITS_OF_NAMES.get(name) or _UNITS.get(suffix, "")


def _default(default: Any) -> str:
    if default is dataclasses.MISSING:
        return "refused"
    return "none" if default is None else code(str(default)) if default != "" else "empty"
