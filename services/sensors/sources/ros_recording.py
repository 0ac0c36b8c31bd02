"""A recording of ROS played in the place of a sensor."""

from __future__ import annotations

from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Any

from services.sensors.sources.bag import Bag, Rosbag
from services.sensors.sources.interface import Recording
from services.sensors.sources.mcap_file import McapFile
from services.sensors.sources.ros_conversion import CONVERSIONS
from services.sensors.sources.topics import choose_topics
from shared.errors import InputFileError, MessageError

_NS_PER_S = 10**9


def read_bag(path: Path, kind: str, topic: str | None, frame: str) -> Recording:
    """What an MCAP file, a rosbag2 folder or a ROS 1 bag has for a sensor of a kind (lidar, depth), put in `frame`.

    topic: of the scans or images, see `choose_topics`.

    Raises:
        InputFileError: it cannot be read, it has not the right topics, or a message cannot be used.
    """
    bag = _opened(path)
    types = bag.topics()
    try:
        topics = choose_topics(types, kind, topic)
    except InputFileError as error:
        raise InputFileError(f"{path}: {error}") from error
    num_read: Counter[str] = Counter()
    with closing(bag.messages(topics)) as messages:
        while True:
            try:
                name, message = next(messages)
            except StopIteration as end:
                return str(end.value)
            try:
                converted = CONVERSIONS[types[name]](message, _stamp_ns(message), num_read[name], frame)
            except (MessageError, ValueError) as error:
                raise InputFileError(f"{path}: {name}, message {num_read[name] + 1}: {error}") from error
            num_read[name] += 1
            yield converted


def _opened(path: Path) -> Bag:
    if not path.exists():
        raise InputFileError(f"{path}: no such file")
    return McapFile(path) if path.suffix == ".mcap" and path.is_file() else Rosbag(path)


def _stamp_ns(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * _NS_PER_S + int(stamp.nanosec)
