"""Declares and checks the fields of a message: one `FieldSpec` a field, read from its annotation.

Both the messages (checked when built) and the codec (bytes in and out) use these specs, so there is one truth.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import types
import typing
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.errors import MessageError

MAX_TEXT_CHARS = 16 * 1024 * 1024
MAX_NAME_CHARS = 255
MAX_TUPLE_ITEMS = 100_000
_QUATERNION_TOLERANCE = 1e-3
_INT64_RANGE = (-(2**63), 2**63 - 1)


@dataclass(frozen=True, slots=True)
class Array:
    """Marks an `Annotated[NDArray, Array(...)]` field.

    dtype: numpy dtype name. shape: fixed sizes, or names of sizes that must agree within one message.
    is_inline: a small array that travels as a list of numbers, so that any client can write and read it.
    is_pose: the last axis is x y z and a quaternion x y z w, which must be of length 1.
    """

    dtype: str
    shape: tuple[int | str, ...]
    is_inline: bool = False
    is_pose: bool = False


@dataclass(frozen=True, slots=True)
class Text:
    """Marks an `Annotated[str, Text(...)]` field: no longer than this."""

    max_chars: int


@dataclass(frozen=True, slots=True)
class FieldSpec:
    """What one field holds: exactly one of `array`, `item` (a tuple of it), `message`, `choices` or a scalar `kind`."""

    name: str
    is_optional: bool = False
    has_default: bool = False
    kind: type | None = None
    max_chars: int = MAX_TEXT_CHARS
    array: Array | None = None
    item: FieldSpec | None = None
    message: type | None = None
    choices: type[enum.Enum] | None = None


_SPECS: dict[type, tuple[FieldSpec, ...]] = {}


def specs_of(message_type: type) -> tuple[FieldSpec, ...]:
    """The specs of a message dataclass, in field order; read from its annotations once."""
    if message_type not in _SPECS:
        hints = typing.get_type_hints(message_type, include_extras=True)
        _SPECS[message_type] = tuple(
            dataclasses.replace(
                _spec(field.name, hints[field.name]), has_default=field.default is not dataclasses.MISSING
            )
            for field in dataclasses.fields(message_type)
        )
    return _SPECS[message_type]


def _spec(name: str, hint: Any) -> FieldSpec:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        (inner,) = (arg for arg in args if arg is not type(None))
        return dataclasses.replace(_spec(name, inner), is_optional=True)
    if origin is typing.Annotated:
        mark = args[1]
        return (
            FieldSpec(name, kind=str, max_chars=mark.max_chars)
            if isinstance(mark, Text)
            else FieldSpec(name, array=mark)
        )
    if origin is tuple:
        return FieldSpec(name, item=_spec(f"{name}[]", args[0]))
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return FieldSpec(name, choices=hint)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return FieldSpec(name, message=hint)
    if hint in (int, float, str, bool):
        return FieldSpec(name, kind=hint)
    raise TypeError(f"message field {name}: no rule for type {hint!r}")


def checked(spec: FieldSpec, value: Any, sizes: dict[str, int]) -> Any:
    """The value as the message keeps it (arrays contiguous and read-only), or MessageError naming the field."""
    if value is None:
        if spec.is_optional:
            return None
        raise MessageError(f"{spec.name} is missing")
    if spec.array is not None:
        return _checked_array(spec.name, spec.array, value, sizes)
    if spec.item is not None:
        if not isinstance(value, tuple) or len(value) > MAX_TUPLE_ITEMS:
            raise MessageError(f"{spec.name} must be a tuple of at most {MAX_TUPLE_ITEMS} items")
        return tuple(checked(spec.item, item, {}) for item in value)
    expected = spec.message or spec.choices
    if expected is not None:
        if not isinstance(value, expected):
            raise MessageError(f"{spec.name} must be a {expected.__name__}, got {type(value).__name__}")
        return value
    return _checked_scalar(spec, value)


def _checked_scalar(spec: FieldSpec, value: Any) -> Any:
    kind = spec.kind
    if kind is float and isinstance(value, int | float | np.floating) and not isinstance(value, bool):
        return _checked_float(spec.name, value)
    if kind is int and isinstance(value, int | np.integer) and not isinstance(value, bool):
        if not _INT64_RANGE[0] <= value <= _INT64_RANGE[1]:
            raise MessageError(f"{spec.name} is outside the 64-bit integers")
        return int(value)
    if kind is bool and isinstance(value, bool | np.bool_):
        return bool(value)
    if kind is str and isinstance(value, str):
        return _checked_text(spec, value)
    assert kind is not None
    raise MessageError(f"{spec.name} must be {kind.__name__}, got {type(value).__name__}")


def _checked_float(name: str, value: float | np.floating) -> float:
    try:
        number = float(value)
    except OverflowError:
        raise MessageError(f"{name} is a number too large for float64") from None
    if not math.isfinite(number):
        raise MessageError(f"{name} is {number}: must be finite")
    return number


def _checked_text(spec: FieldSpec, text: str) -> str:
    if len(text) > spec.max_chars:
        raise MessageError(f"{spec.name} has {len(text)} characters, at most {spec.max_chars} are allowed")
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise MessageError(f"{spec.name} is not Unicode text: {error.reason} at character {error.start}") from None
    return text


def _checked_array(name: str, mark: Array, value: Any, sizes: dict[str, int]) -> NDArray[Any]:
    try:
        array = np.ascontiguousarray(value, dtype=np.dtype(mark.dtype))
    except (TypeError, ValueError) as error:
        raise MessageError(f"{name} must be {mark.dtype} numbers of shape {shape_text(mark)}") from error
    if array.ndim != len(mark.shape):
        raise MessageError(f"{name} must have shape {shape_text(mark)}, got {array.shape}")
    for size, expected in zip(array.shape, mark.shape, strict=True):
        wanted = sizes.setdefault(expected, size) if isinstance(expected, str) else expected
        if size != wanted:
            raise MessageError(f"{name} must have shape {shape_text(mark)}, got {array.shape} ({expected} is {wanted})")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0]
        place = ", ".join(str(i) for i in where)
        raise MessageError(f"{name}[{place}] is {array[tuple(where)]}: must be finite")
    if mark.is_pose:
        _check_quaternions(name, array)
    if array is value and array.flags.writeable:
        array = array.copy()
    array.setflags(write=False)
    return array


def _check_quaternions(name: str, poses: NDArray[Any]) -> None:
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(poses[..., 3:], axis=-1)
    if (np.abs(lengths - 1.0) > _QUATERNION_TOLERANCE).any():
        worst = float(lengths.flat[np.argmax(np.abs(lengths - 1.0))])
        raise MessageError(f"{name} has a quaternion of length {worst:g}: must be 1")


def shape_text(mark: Array) -> str:
    """The declared shape for people: (N, 3)."""
    return "(" + ", ".join(str(size) for size in mark.shape) + ("," if len(mark.shape) == 1 else "") + ")"
