"""Which channels a recording takes: patterns of keys below `hyrecro/`, such as `lidar/*`."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase

from shared.messaging.channels import Channel


class Selection:
    """The recorded channels whose keys match one of the patterns."""

    def __init__(self, patterns: tuple[str, ...]) -> None:
        self.patterns = patterns
        self._is_chosen: dict[str, bool] = {}

    def __contains__(self, channel: Channel) -> bool:
        is_chosen = self._is_chosen.get(channel.key)
        if is_chosen is None:
            is_chosen = channel.is_recorded and any(fnmatchcase(channel.key, pattern) for pattern in self.patterns)
            self._is_chosen[channel.key] = is_chosen
        return is_chosen


def problem_with(patterns: tuple[str, ...], channels: Iterable[Channel]) -> str | None:
    """What to say of a pattern that no recorded key matches; None if there is none."""
    keys = [channel.key for channel in channels if channel.is_recorded]
    for pattern in patterns:
        if not any(fnmatchcase(key, pattern) or fnmatchcase(pattern, key) for key in keys):
            return f"channels: '{pattern}' matches no recorded key, such as lidar/points or map/*"
    return None
