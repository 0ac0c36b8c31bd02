"""Fuzzed payloads as real puts into a real pipeline: who got them, what was refused, who is alive, who has grown."""

from __future__ import annotations

import contextlib
import sys
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import zenoh

from shared.errors import CodecError
from shared.messaging.bus import Bus
from shared.messaging.channels import CHANNELS, HEALTH, ROBOT_STOP, Channel
from shared.messaging.codec import decode
from shared.messaging.messages import ChannelCount, Health, Message
from tests.e2e.conftest import ALL_SERVICES, wait_for_services
from tests.support.processes import Running, started, wait_until

_PUTS_A_BURST = 50
_PAUSE_S = 0.1
"""500 puts a second: a burst fits in every queue of the way."""
_WARM_UP = 0.5
_MAX_PLANNING_S = 180.0
"""The planner plans each step that it is asked for, one after the other; the last may wait so long."""
_MIB = 1024 * 1024
_HEARERS = ("recorder", "sim", "planner")
"""Who hears commands."""


class Source(Protocol):
    """Where payloads come from."""

    def of(self, message_type: type[Message], *, is_command: bool) -> bytes:
        """Nearly a message of this type."""


def over_the_bus(num: int, payloads: Source, folder: Path) -> dict[str, Any]:
    """Half of the puts go to the commands' keys, half, of what is no message at all, to the keys of services."""
    command = [sys.executable, "-m", "cli.main", "up"]
    with started([*command], folder / "pipeline") as running:
        wait_for_services(running, ALL_SERVICES)
        with running.bus() as bus:
            before = _counts(bus)
            sent: Counter[str] = Counter()
            _put(running, sent, payloads, round(num * _WARM_UP))
            warm = _rss(bus)
            _put(running, sent, payloads, num - round(num * _WARM_UP))
            with contextlib.suppress(AssertionError):
                wait_until(lambda: not _missing(before, _counts(bus), sent), "every put counted", _MAX_PLANNING_S)
            after, rss = _counts(bus), _rss(bus)
            problems = _missing(before, after, sent)
        num_refused = sum(after["recorder", key].num_refused - _of(before, "recorder", key).num_refused for key in sent)
    return {
        "num_sent": sent.total(),
        "num_keys": len(sent),
        "num_refused_by_recorder": num_refused,
        "unbalanced": problems,
        "services_alive": sorted(rss),
        "rss_warm_mib": warm,
        "rss_end_mib": rss,
    }


def _put(running: Running, sent: Counter[str], payloads: Source, num: int) -> None:
    commands = [channel for channel in CHANNELS if channel.is_command and channel is not ROBOT_STOP]
    others = [channel.of("sim") for channel in CHANNELS if channel.is_recorded and not channel.is_command]
    config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{running.endpoint}"]}}}}')
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        for number in range(num):
            channels = commands if number % 2 else others
            channel = channels[number // 2 % len(channels)]
            payload = payloads.of(channel.message, is_command=channel.is_command)
            if not channel.is_command:
                payload = _no_message(channel, payload)
            session.put(channel.key_expr, payload, congestion_control=zenoh.CongestionControl.BLOCK)
            sent[channel.key_expr] += 1
            if number % _PUTS_A_BURST == 0:
                time.sleep(_PAUSE_S)


def _no_message(channel: Channel, payload: bytes) -> bytes:
    """What could be read is cut: a measurement that is none of the pipeline's would change what it measures."""
    try:
        decode(channel.message, payload)
    except CodecError:
        return payload
    return payload[:-1]


def _missing(
    before: dict[tuple[str, str], ChannelCount], after: dict[tuple[str, str], ChannelCount], sent: Counter[str]
) -> list[str]:
    """What does not balance yet. Of commands each hearer counts all; of others the recorder counts the refused."""
    commands = {channel.key_expr for channel in CHANNELS if channel.is_command}
    missing = []
    for (name, key), count in after.items():
        if name not in _HEARERS or key not in sent:
            continue
        old = _of(before, name, key)
        refused = count.num_refused - old.num_refused
        handled = refused + count.num_received - old.num_received + count.num_dropped - old.num_dropped
        if key in commands and handled < sent[key] and (count.num_received or count.num_refused):
            missing.append(f"{name}: {key}: {handled} of {sent[key]}")
        if key not in commands and name == "recorder" and refused != sent[key]:
            missing.append(f"{name}: {key}: {refused} refused of {sent[key]}")
    lacking = [key for key in sent if ("recorder", key) not in after]
    return missing + [f"recorder: {key}: none of {sent[key]}" for key in lacking]


def _of(counts: dict[tuple[str, str], ChannelCount], name: str, key: str) -> ChannelCount:
    return counts.get((name, key)) or ChannelCount(key=key)


def _healths(bus: Bus) -> list[Health]:
    return [
        wait_until(partial(bus.ask, HEALTH.of(name), Health), f"a heartbeat of {name}") for name in sorted(ALL_SERVICES)
    ]


def _counts(bus: Bus) -> dict[tuple[str, str], ChannelCount]:
    return {(health.service, count.key): count for health in _healths(bus) for count in health.channels}


def _rss(bus: Bus) -> dict[str, float]:
    return {health.service: round(health.rss_bytes / _MIB, 1) for health in _healths(bus)}
