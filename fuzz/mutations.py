"""Payloads that are nearly messages: noise, damaged bytes, fields that are foreign, values that are extreme.

All of them follow from the random generator that is passed in.
"""

from __future__ import annotations

import json
import random
import struct
from collections.abc import Callable
from typing import Any

import msgpack

from shared.messaging.codec import encode
from shared.messaging.messages import Message

INTS = (0, 1, -1, 2, 7, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32, 2**53 + 1, 2**63 - 1, -(2**63))
FLOATS = (0.0, -0.0, 1.0, -1.0, 1e-3, 5e-324, 1e-300, 1e6, 1e18, 1e154, 1e308, -1e308, 0.1)
NOT_FINITE = (float("nan"), float("inf"), float("-inf"))
TEXTS = (
    "",
    " ",
    "A",
    "B",
    "q1",
    "world",
    "map",
    "\x00",
    "\n",
    "../..",
    "é",
    "\U0001f916",
    "\u202e",
    "%s{0}",
    "-",
    "x" * 300,
    "*",
)
FOREIGN: tuple[Any, ...] = (
    None,
    True,
    [],
    {},
    [[]],
    b"",
    b"\x00",
    "1",
    [1, "a"],
    {"a": 1},
    [[1, 2], [3]],
    [None],
    2**64 - 1,
)


def payload_like(message: Message, rng: random.Random, *, is_command: bool) -> bytes:
    """Bytes that are, or nearly are, a message of this one's type."""
    kinds: list[Callable[[], bytes]] = [
        lambda: damaged(encode(message), rng),
        lambda: packed(_foreign(plain_of(message), rng)),
        lambda: packed(_extreme(plain_of(message), rng)),
        lambda: packed(_extreme(plain_of(message), rng)),
        lambda: rng.randbytes(rng.randrange(40)),
    ]
    if is_command:
        kinds += [
            lambda: _json(_extreme(plain_of(message), rng)),
            lambda: damaged(_json(plain_of(message)), rng),
            lambda: rng.choice((*TEXTS, "[1]", "{}", "C", "null", "1e999")).encode(),
        ]
    return rng.choice(kinds)()


def plain_of(message: Message) -> dict[str, Any]:
    """The message as the map that travels."""
    plain: dict[str, Any] = msgpack.unpackb(encode(message))
    return plain


def packed(plain: Any) -> bytes:
    """The map as MessagePack."""
    payload: bytes = msgpack.packb(plain)
    return payload


def damaged(data: bytes, rng: random.Random) -> bytes:
    """The bytes with one to four places changed, cut out, doubled or overwritten by a large length."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(changed) + 1)
        match rng.randrange(5):
            case 0 if at < len(changed):
                changed[at] ^= 1 << rng.randrange(8)
            case 1:
                del changed[at:]
            case 2:
                del changed[at : at + rng.randint(1, 8)]
            case 3:
                changed[at:at] = changed[at : at + rng.randint(1, 32)]
            case _:
                length = rng.choice((2**32 - 1, 2**31, 65536, 0))
                changed[at : at + 4] = struct.pack(rng.choice(("<I", ">I")), length)
    return bytes(changed)


def _foreign(plain: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    """With a field of another kind, without one, or with one too many."""
    name = rng.choice(list(plain))
    match rng.randrange(4):
        case 0:
            return {key: value for key, value in plain.items() if key != name}
        case 1:
            return {**plain, rng.choice(("Q", "speed", "", "stamp", name + "_")): 1}
    return {**plain, name: rng.choice((*FOREIGN, *NOT_FINITE, *TEXTS))}


def _extreme(value: Any, rng: random.Random) -> Any:
    """The same layout, some of its values replaced by extreme ones of their kind."""
    if isinstance(value, dict):
        chosen = rng.choice(list(value)) if value else None
        return {
            key: _extreme(each, rng) if key == chosen or rng.random() < 0.2 else each for key, each in value.items()
        }
    if isinstance(value, list):
        return _extreme_list(value, rng)
    if isinstance(value, bool) or value is None:
        return rng.choice((True, False, None))
    if isinstance(value, int):
        return rng.choice(INTS)
    if isinstance(value, float):
        return rng.choice(FLOATS)
    if isinstance(value, bytes):
        return _extreme_bytes(value, rng)
    return rng.choice((value, *TEXTS))


def _extreme_list(value: list[Any], rng: random.Random) -> list[Any]:
    match rng.randrange(6):
        case 0:
            return []
        case 1:
            return value * 2
        case 2 if value:
            return value[: rng.randrange(len(value))]
    chance = rng.choice((0.1, 1.0))
    return [_extreme(each, rng) if rng.random() < chance else each for each in value]


def _extreme_bytes(value: bytes, rng: random.Random) -> bytes:
    """Bulk arrays: of other numbers, or of another length."""
    match rng.randrange(4):
        case 0:
            return b""
        case 1:
            return value * rng.choice((2, 16))
        case 2:
            return rng.randbytes(len(value))
    number = rng.choice(FLOATS)
    pattern = struct.pack("<f", number) if abs(number) < 1e38 else struct.pack("<d", number)
    return (pattern * (len(value) // len(pattern) + 1))[: len(value)]


def _json(plain: Any) -> bytes:
    return json.dumps(plain, default=lambda value: value.hex()).encode()
