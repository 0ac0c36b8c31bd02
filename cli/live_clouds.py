"""Clouds taken live from the bus."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from shared.errors import BusError, CloudFileError, InputFileError
from shared.messaging.bus import Bus
from shared.messaging.channels import CHANNELS, PREFIX, Channel, channel_of_key
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox
from shared.messaging.messages import LidarScan, PointCloud
from shared.runtime.config import Config

CloudMessage = LidarScan | PointCloud
Float = NDArray[np.float64]

_SILENCE_S = 5.0
_POLL_S = 0.1


def cloud_channel(key: str) -> Channel:
    """The channel of a key, with or without the prefix, on which clouds travel.

    Raises:
        InputFileError: there is no such channel, or it carries no clouds.
    """
    channel = channel_of_key(key if key.startswith(PREFIX) else PREFIX + key)
    if channel is None or channel.message not in (LidarScan, PointCloud):
        known = ", ".join(each.key for each in CHANNELS if each.message in (LidarScan, PointCloud))
        raise InputFileError(f"--key {key}: no clouds are on it; keys with clouds are {known}")
    return channel


class CloudStream:
    """What comes on one channel."""

    def __init__(self, bus: Bus, channel: Channel) -> None:
        self._channel, self._inbox = channel, Inbox()
        bus.subscribe(channel, self._inbox)

    def newest(self, timeout_s: float) -> CloudMessage | None:
        """The newest message that has come and was not taken yet, waiting for one at most `timeout_s`; else None."""
        newest = self._inbox.take(timeout_s)
        while (later := self._inbox.take(0.0)) is not None:
            newest = later
        if newest is None:
            return None
        return decode(self._channel.message, newest.payload, schema=newest.schema)  # type: ignore[return-value]


@contextmanager
def cloud_stream(config: Config, channel: Channel, is_stopping: Callable[[], bool]) -> Iterator[CloudStream]:
    """A stream over a session of its own.

    Raises:
        BusError: no router.
    """
    with Bus(config.bus, is_stopping=is_stopping) as bus:
        yield CloudStream(bus, channel)


def live_points(config: Config, channel: Channel, is_stopping: Callable[[], bool]) -> Float:
    """The finite points of the newest message on a channel; a kept one is had at once, others when the next comes.

    Raises:
        BusError: no router, or no cloud within 5 s. CloudFileError: it has no points.
    """
    message: CloudMessage | None = None
    with Bus(config.bus, is_stopping=is_stopping) as bus:
        stream = CloudStream(bus, channel)
        message = bus.ask(channel, channel.message) if channel.is_kept else None  # type: ignore[assignment]
        deadline = time.monotonic() + _SILENCE_S
        while message is None and time.monotonic() < deadline and not is_stopping():
            message = stream.newest(_POLL_S)
    if message is None:
        raise BusError(f"no cloud came on {channel.key_expr} within {_SILENCE_S:g} s")
    points_m = message.points_m[np.all(np.isfinite(message.points_m), axis=1)].astype(np.float64)
    if len(points_m) == 0:
        raise CloudFileError(f"{channel.key_expr}: the cloud has no points")
    return points_m
