"""The channel table as people read it."""

from __future__ import annotations

from shared.messaging.channels import CHANNELS, Channel, Delivery
from tools.docs.markdown import code, table


def channel_table() -> str:
    """Every key: what it carries, how it travels, how it is recorded."""
    heads = ["key `hyrecro/...`", "message", "rate", "delivery", "kept", "recorded as"]
    return table(heads, map(_row, CHANNELS))


def linked_channel_table() -> str:
    """The same beside the messages: each name leads to its message, topics are those of the ROS page."""
    heads = ["key `hyrecro/...`", "message", "rate", "delivery", "kept"]
    rows = ([code(c.key), f"[{c.message.__name__}](#{c.message.__name__.lower()})", *_travel(c)] for c in CHANNELS)
    return table(heads, rows)


def ros_table() -> str:
    """From the topic and type that ROS knows to key and message, with the QoS that the delivery stands for."""
    heads = ["topic in a recording", "ROS 2 type", "key `hyrecro/...`", "message", "QoS it is like"]
    rows = (
        [
            code(c.topic) if c.is_recorded else f"{code(c.topic)} (not recorded)",
            code(c.ros_type.replace("/msg", "")),
            code(c.key),
            f"[{c.message.__name__}](reference/messages.md#{c.message.__name__.lower()})",
            _qos(c),
        ]
        for c in CHANNELS
    )
    return table(heads, rows)


def _row(channel: Channel) -> list[str]:
    recorded = f"`{channel.topic}` {channel.ros_type.replace('/msg', '')}"
    return [channel.key, channel.message.__name__, *_travel(channel), recorded]


def _travel(channel: Channel) -> list[str]:
    return [_rate(channel), channel.delivery.name, "yes" if channel.is_kept else ""]


def _rate(channel: Channel) -> str:
    if channel.is_command:
        return "command"
    return f"{channel.rate_hz:g} Hz" if channel.rate_hz else "on change"


def _qos(channel: Channel) -> str:
    if channel.is_command:
        return "reliable; or a service call"
    reliability = "best effort, depth 2" if channel.delivery is Delivery.LATEST else "reliable"
    return reliability + (", transient local" if channel.is_kept else "")
