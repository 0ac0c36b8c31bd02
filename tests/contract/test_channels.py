"""Every channel: unique, complete, and the only place where keys are written."""

import re
from pathlib import Path

import pytest

from shared.messaging.channels import CHANNELS, PREFIX, Delivery, channel_of_key
from shared.messaging.messages import Measurement
from tests.support.examples import EXAMPLES

ROOT = Path(__file__).parents[2]


def test_keys_and_topics_are_unique():
    assert len({channel.key for channel in CHANNELS}) == len(CHANNELS)
    assert len({channel.topic for channel in CHANNELS}) == len(CHANNELS)


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda channel: channel.key)
def test_each_channel_is_complete(channel):
    concrete = channel.of("sim")
    assert channel_of_key(concrete.key_expr) == concrete
    assert channel_of_key("robot2/" + concrete.key_expr) == concrete, "a namespace may stand before the key"
    assert channel.message in {type(example) for example in EXAMPLES}
    assert channel.is_command != issubclass(channel.message, Measurement), (
        "commands count from receipt, the rest is stamped"
    )
    assert channel.delivery is Delivery.EVERY or channel.rate_hz, "only a stream may be dropped"


@pytest.mark.parametrize(
    "key", ["", "hyrecro/", "hyrecro/nothing", "hyrecro/health/", "hyrecro/health/a/b", "leg/state"]
)
def test_other_keys_have_no_channel(key):
    assert channel_of_key(key) is None


def test_no_key_is_written_elsewhere():
    names = "|".join(re.escape(channel.key.removesuffix("*")) for channel in CHANNELS if "/" in channel.key)
    literal = re.compile(rf"""["']({PREFIX})?({names})""")
    found = [
        f"{path.relative_to(ROOT)}:{number}"
        for folder in ("cli", "services", "shared")
        for path in (ROOT / folder).rglob("*.py")
        if path.name != "channels.py"
        for number, line in enumerate(path.read_text().splitlines(), start=1)
        if literal.search(line)
    ]
    assert found == []
