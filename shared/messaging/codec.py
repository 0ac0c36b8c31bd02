"""Messages to bytes and back: MessagePack maps, bulk arrays as little-endian `bin`, small arrays as lists.

Commands may also come as JSON text or as a bare value, since that is what people type. Nothing here guesses: bytes
that are not exactly the message they should be raise CodecError.
"""

from __future__ import annotations

import difflib
import enum
import json
import math
from typing import Any, TypeVar

import msgpack
import numpy as np

from shared.errors import CodecError, MessageError
from shared.messaging.channels import channel_of_key
from shared.messaging.fields import MAX_TEXT_CHARS, MAX_TUPLE_ITEMS, Array, FieldSpec, specs_of
from shared.messaging.messages import Message

M = TypeVar("M", bound=Message)

MIME = "application/msgpack"
MAX_PAYLOAD_BYTES = 256 * 1024 * 1024
MAX_COMMAND_BYTES = 64 * 1024
MAX_SHOWN_NUMBERS = 64
"""A bulk array longer than this is shown to people as its type and shape."""
_MAX_SHOWN_CHARS = 40


def schema_of(message_type: type[Message]) -> str:
    """Name and version of a message's layout, as it travels in Zenoh's encoding: `hyrecro.LegState/1`."""
    return f"hyrecro.{message_type.__name__}/{message_type.VERSION}"


def encode(message: Message) -> bytes:
    """The message as a MessagePack map."""
    packed: bytes = msgpack.packb(_to_plain(message))
    return packed


def decode(message_type: type[M], payload: bytes, *, schema: str | None = None) -> M:
    """The message of these bytes.

    schema: what the sender says the bytes are; None = not said.

    Raises:
        CodecError: another schema, too large, not MessagePack, or not this message; the text names the field.
    """
    wanted = schema_of(message_type)
    if schema is not None and schema != wanted:
        raise CodecError(f"schema is {schema[:_MAX_SHOWN_CHARS]!r}, expected {wanted!r}")
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise CodecError(f"{len(payload)} bytes, at most {MAX_PAYLOAD_BYTES} are allowed")
    return _from_plain(message_type, _unpack(payload))


def decode_command(message_type: type[M], payload: bytes) -> M:
    """The command of these bytes: a MessagePack map, JSON text, or a bare value such as `B`.

    Raises:
        CodecError: as `decode`; never for a message that is certain.
    """
    try:
        return _read_command(message_type, payload)
    except CodecError:
        if message_type.IS_CERTAIN:
            return message_type()
        raise


def _read_command(message_type: type[M], payload: bytes) -> M:
    _check_command_size(payload)
    plain = _command_to_plain(payload)
    if not isinstance(plain, dict) and message_type.SHORTHAND is not None:
        plain = {message_type.SHORTHAND: plain}
    return _from_plain(message_type, plain)


def _check_command_size(payload: bytes) -> None:
    if not 0 < len(payload) <= MAX_COMMAND_BYTES:
        raise CodecError(f"a command has 1 to {MAX_COMMAND_BYTES} bytes, got {len(payload)}")


def to_text(key: str, payload: bytes) -> str:
    """A payload as one line of JSON for people, by the message type of its key (decoder `msgpack` of zenoh-cli).

    Raises:
        CodecError: bytes that are not a message of that key.
    """
    channel = channel_of_key(str(key))
    if channel is not None and not channel.is_command:
        return json.dumps(to_jsonable(decode(channel.message, payload)))
    _check_command_size(payload)
    try:
        return json.dumps(_command_to_plain(payload), default=repr)
    except RecursionError:
        raise CodecError("lists or maps are nested too deeply") from None


def from_text(key: str, text: str) -> bytes:
    """What a person typed for a command key, as MessagePack (encoder `msgpack` of zenoh-cli).

    Raises:
        CodecError: not a command key, or not its message.
    """
    channel = channel_of_key(str(key))
    if channel is None or not channel.is_command:
        raise CodecError(f"{key} is not a command key")
    try:
        payload = text.encode()
    except UnicodeEncodeError as error:
        raise CodecError(f"not Unicode text: {error.reason}") from error
    return encode(decode_command(channel.message, payload))


def to_jsonable(message: Message) -> dict[str, Any]:
    """The message as JSON types; a long array is shown as its type and shape."""

    def shown(value: Any) -> Any:
        if isinstance(value, Message):
            return to_jsonable(value)
        if isinstance(value, tuple):
            return [shown(item) for item in value]
        if isinstance(value, enum.Enum):
            return value.value
        if isinstance(value, np.ndarray):
            return value.tolist() if value.size <= MAX_SHOWN_NUMBERS else f"{value.dtype}{list(value.shape)}"
        return value

    return {spec.name: shown(getattr(message, spec.name)) for spec in specs_of(type(message))}


# ---- messages to plain maps


def _to_plain(message: Message) -> dict[str, Any]:
    return {spec.name: _plain_value(spec, getattr(message, spec.name)) for spec in specs_of(type(message))}


def _plain_value(spec: FieldSpec, value: Any) -> Any:
    if value is None:
        return None
    if spec.array is not None:
        return value.tolist() if spec.array.is_inline else value.astype(_wire_dtype(spec.array), copy=False).tobytes()
    if spec.item is not None:
        item = spec.item
        return [_plain_value(item, each) for each in value]
    if spec.message is not None:
        return _to_plain(value)
    return value.value if spec.choices is not None else value


def _wire_dtype(mark: Array) -> np.dtype[Any]:
    return np.dtype(mark.dtype).newbyteorder("<")


# ---- plain maps to messages


_UNPACK_LIMITS = {
    "strict_map_key": True,
    "max_str_len": 4 * MAX_TEXT_CHARS,
    "max_array_len": MAX_TUPLE_ITEMS,
    "max_map_len": 1024,
    "max_ext_len": 0,
}


def _unpack(payload: bytes) -> Any:
    try:
        _check_lengths(payload)
        return msgpack.unpackb(payload, object_pairs_hook=_unique, **_UNPACK_LIMITS)
    except (ValueError, msgpack.exceptions.UnpackException, RecursionError) as error:
        raise CodecError(f"not one MessagePack value: {error or type(error).__name__}") from error


def _check_lengths(payload: bytes) -> None:
    """Walks over the payload without building anything: for a list, memory is taken as soon as its length is read."""
    unpacker = msgpack.Unpacker(max_buffer_size=len(payload), **_UNPACK_LIMITS)
    unpacker.feed(payload)
    try:
        unpacker.skip()
    except msgpack.OutOfData:
        raise ValueError("it ends too early") from None


def _unique(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    """A map whose keys are texts, each there once; else ValueError."""
    plain: dict[str, Any] = {}
    for name, value in pairs:
        if not isinstance(name, str):
            raise ValueError("a key of a map is no text")
        if name in plain:
            raise ValueError(f"{name[:_MAX_SHOWN_CHARS]!r} is given twice")
        plain[name] = value
    return plain


def _command_to_plain(payload: bytes) -> Any:
    first = payload[:1]
    if first in (b"{", b"[", b'"'):
        try:
            return json.loads(payload, object_pairs_hook=_unique)
        except (ValueError, RecursionError) as error:
            raise CodecError(f"not JSON: {error}") from error
    if first and (0x80 <= first[0] <= 0x8F or first[0] in (0xDE, 0xDF)):
        return _unpack(payload)
    try:
        return payload.decode("ascii").strip()
    except UnicodeDecodeError as error:
        raise CodecError("neither MessagePack, JSON nor plain text") from error


def _from_plain(message_type: type[M], plain: Any) -> M:
    if not isinstance(plain, dict):
        raise CodecError(f"{message_type.__name__} must be a map, got {type(plain).__name__}")
    specs = {spec.name: spec for spec in specs_of(message_type)}
    for name in plain:
        if name not in specs:
            shown = name[:_MAX_SHOWN_CHARS]
            near = difflib.get_close_matches(shown, specs, n=1)
            hint = f", did you mean {near[0]}?" if near else f"; known are {', '.join(specs)}"
            raise CodecError(f"{message_type.__name__} has no field {shown!r}{hint}")
    missing = [name for name in specs if name not in plain and not specs[name].has_default]
    if missing:
        raise CodecError(f"{message_type.__name__} lacks {', '.join(missing)}")
    try:
        return message_type(**{name: _value(specs[name], value) for name, value in plain.items()})
    except MessageError as error:
        raise CodecError(f"{message_type.__name__}: {error}") from error


def _value(spec: FieldSpec, value: Any) -> Any:
    if value is None:
        return None
    if spec.array is not None:
        return _array(spec.name, spec.array, value)
    if spec.item is not None:
        item = spec.item
        if not isinstance(value, list):
            raise CodecError(f"{spec.name} must be a list")
        return tuple(_value(item, each) for each in value)
    if spec.message is not None:
        return _from_plain(spec.message, value)
    if spec.choices is not None:
        try:
            return spec.choices(value)
        except ValueError as error:
            allowed = ", ".join(str(choice.value) for choice in spec.choices)
            raise CodecError(f"{spec.name} is {_shown(value)}, must be one of {allowed}") from error
    return value


def _shown(value: Any) -> str:
    """A value of a foreign kind for people: of lists and maps, which may be deep, only what they are."""
    if isinstance(value, str):
        return repr(value[:_MAX_SHOWN_CHARS])
    return repr(value) if isinstance(value, int | float) else f"a {type(value).__name__}"


def _array(name: str, mark: Array, value: Any) -> Any:
    if mark.is_inline:
        if not isinstance(value, list) or not _is_numbers(value):
            raise CodecError(f"{name} must be a list of numbers")
        try:
            return np.array(value, dtype=mark.dtype)
        except OverflowError as error:
            raise CodecError(f"{name} has a number too large for {mark.dtype}") from error
    if not isinstance(value, bytes):
        raise CodecError(f"{name} must be bytes ({mark.dtype}, little-endian)")
    dtype, row = _wire_dtype(mark), math.prod(size for size in mark.shape if isinstance(size, int))
    if len(value) % (dtype.itemsize * row):
        raise CodecError(f"{name} has {len(value)} bytes, not a multiple of {dtype.itemsize * row}")
    return np.frombuffer(value, dtype=dtype).reshape([size if isinstance(size, int) else -1 for size in mark.shape])


def _is_numbers(value: list[Any], depth: int = 2) -> bool:
    """Whether the list holds numbers only, or lists of equally many numbers."""
    if value and all(isinstance(each, list) for each in value):
        return depth > 1 and len({len(each) for each in value}) == 1 and all(_is_numbers(each, 1) for each in value)
    return all(isinstance(each, int | float) and not isinstance(each, bool) for each in value)
