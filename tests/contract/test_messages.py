"""Every message: survives the wire unchanged; truncated, mistyped and wrong-version bytes are refused."""

import contextlib

import msgpack
import numpy as np
import pytest
from hypothesis import given, strategies as st

from shared.errors import CodecError, MessageError
from shared.messaging import messages as m
from shared.messaging.channels import CHANNELS
from shared.messaging.codec import decode, decode_command, encode, schema_of
from shared.messaging.fields import specs_of
from tests.support.examples import EXAMPLES

pytestmark = pytest.mark.parametrize("message", EXAMPLES, ids=lambda message: type(message).__name__)


def test_survives_the_wire(message):
    assert decode(type(message), encode(message), schema=schema_of(type(message))) == message


def test_every_truncation_is_refused(message):
    payload = encode(message)
    for size in {0, 1, len(payload) // 3, len(payload) // 2, len(payload) - 1}:
        with pytest.raises(CodecError):
            decode(type(message), payload[:size])


def test_another_version_is_refused(message):
    with pytest.raises(CodecError, match="expected 'hyrecro"):
        decode(type(message), encode(message), schema=f"hyrecro.{type(message).__name__}/999")


def test_an_unknown_field_is_refused_by_name(message):
    plain = msgpack.unpackb(encode(message)) | {"colour": 3}
    with pytest.raises(CodecError, match="colour"):
        decode(type(message), msgpack.packb(plain))


def test_a_mistyped_field_is_refused_by_name(message):
    plain = msgpack.unpackb(encode(message))
    name = next(iter(plain))
    with pytest.raises(CodecError, match=name):
        decode(type(message), msgpack.packb(plain | {name: {"a": 1}}))


def test_a_missing_field_is_refused_by_name(message):
    plain = msgpack.unpackb(encode(message))
    needed = [spec.name for spec in specs_of(type(message)) if not spec.has_default]
    for name in needed:
        rest = {key: value for key, value in plain.items() if key != name}
        with pytest.raises(CodecError, match=f"lacks.*{name}"):
            decode(type(message), msgpack.packb(rest))
    if not needed and not message.IS_CERTAIN:  # what asks for nothing is no command
        with pytest.raises(CodecError, match=type(message).__name__):
            decode(type(message), msgpack.packb({}))


def test_arrays_are_read_only(message):
    arrays = [value for name in message.__slots__ if isinstance(value := getattr(message, name), np.ndarray)]
    assert all(not array.flags.writeable for array in arrays)


def test_stamps_and_numbers_that_cannot_be_are_refused(message):
    plain = msgpack.unpackb(encode(message))
    for name, value in (("stamp_ns", -1), ("stamp_ns", 2**62), ("seq", -1)):
        if name in plain:
            with pytest.raises(CodecError, match=f"{name} is {value}"):
                decode(type(message), msgpack.packb(plain | {name: value}))
    assert isinstance(message, m.Measurement) == ("stamp_ns" in plain)


def test_measurements_carry_stamp_seq_and_frame(message):
    commands = {channel.message for channel in CHANNELS if channel.is_command}
    is_plain = type(message) in commands | {m.ChannelCount, m.ChannelRecord, m.Plane}
    assert is_plain or (message.stamp_ns >= 0 and message.seq >= 0 and isinstance(message.frame, str))


@given(noise=st.binary(max_size=200))
def test_noise_never_raises_anything_else(message, noise):
    for read in (decode, decode_command):
        with contextlib.suppress(CodecError):
            assert isinstance(read(type(message), noise), type(message))


def test_values_that_are_not_finite_are_refused(message):
    plain = msgpack.unpackb(encode(message))
    numbers = [name for name, value in plain.items() if isinstance(value, float)]
    for name in numbers:
        with pytest.raises(CodecError, match=f"{name} is nan"):
            decode(type(message), msgpack.packb(plain | {name: float("nan")}))
    with pytest.raises(MessageError, match="must be int"):
        m.Clock(stamp_ns=0.5, seq=0, frame="world")
