"""Which channels of a recording are replayed, and where they go."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from fnmatch import fnmatchcase

from shared.errors import InputFileError
from shared.messaging.channels import (
    EVAL_METRICS,
    EVENTS,
    HEALTH,
    MAP_CLOUD,
    MAP_ODOMETRY,
    MAP_PLANES,
    MAP_STATUS,
    RECORDER_CONTROL,
    RECORDER_STATUS,
    REPLAY_CONTROL,
    Channel,
)

OF_THEN = tuple(channel.key for channel in (HEALTH, RECORDER_STATUS, RECORDER_CONTROL, REPLAY_CONTROL))
"""Of processes that lived then, and their recording: replayed only where it is asked for."""
OF_MAPPING = tuple(of.key for of in (MAP_ODOMETRY, MAP_STATUS, MAP_CLOUD, MAP_PLANES, EVAL_METRICS, EVENTS))
"""What follows from mapping, and is said anew where a recording is mapped again."""


def chosen(
    recorded: Iterable[Channel],
    patterns: Iterable[str],
    renames: Iterable[str],
    *,
    with_commands: bool = False,
    is_mapped_again: bool = False,
) -> dict[Channel, Channel]:
    """Recorded channel -> the channel it goes to.

    patterns: of keys, such as `lidar/*`; none: all but OF_THEN, and but OF_MAPPING where it is mapped again. renames:
    FROM=TO, of keys or of what stands before a `/`. Commands only with_commands: they move robots.

    Raises:
        InputFileError: a pattern or a name that nothing bears, two channels of one name, or nothing that is left.
    """
    left_out = (*OF_THEN, *(OF_MAPPING if is_mapped_again else ()))
    allowed = [channel for channel in recorded if with_commands or not channel.is_command]
    keys = sorted(channel.key for channel in allowed)
    wanted = tuple(patterns)
    for pattern in wanted:
        if not any(fnmatchcase(key, pattern) for key in keys):
            raise InputFileError(f"no channel '{pattern}' to replay; there are {', '.join(keys) or 'none'}")
    taken = [channel for channel in allowed if _is_wanted(channel.key, wanted, left_out)]
    if not taken:
        raise InputFileError(f"nothing is left to replay of {', '.join(keys) or 'an empty recording'}")
    return _renamed(taken, tuple(renames))


def _is_wanted(key: str, patterns: tuple[str, ...], left_out: tuple[str, ...]) -> bool:
    if patterns:
        return any(fnmatchcase(key, pattern) for pattern in patterns)
    return not any(fnmatchcase(key, pattern) for pattern in left_out)


def _renamed(channels: list[Channel], renames: tuple[str, ...]) -> dict[Channel, Channel]:
    outputs = {channel: channel for channel in channels}
    for rename in renames:
        old, _, new = rename.partition("=")
        named = [channel for channel in channels if channel.key == old or channel.key.startswith(old + "/")]
        if not old or not new.strip("/") or not named:
            keys = ", ".join(channel.key for channel in channels)
            raise InputFileError(f"--rename {rename}: must be FROM=TO, FROM one of {keys} or the part before its /")
        for channel in named:
            key = new + channel.key.removeprefix(old)
            outputs[channel] = replace(channel, key=key, topic=f"/{key}")
    doubled = [key for key, num in Counter(channel.key for channel in outputs.values()).items() if num > 1]
    if doubled:
        raise InputFileError(f"two channels would be called {', '.join(doubled)}")
    return outputs
