"""Wiring of a sensor that is played from a recording: the same channels as the simulated one of that name."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from services.sensors.sources.interface import Recording
from services.sensors.sources.ouster_pcap import DEFAULT_PYTHON, PYTHON_VARIABLE, metadata_of, read_pcap
from services.sensors.sources.playback import SourcePlayback
from services.sensors.sources.ros_recording import read_bag
from services.sensors.sources.world import world_of_map
from shared.errors import ConfigError, InputFileError
from shared.messaging.channels import TF_STATIC, sensor_channels
from shared.runtime.config import Config
from shared.runtime.node import Context, Node

_PACKETS = (".pcap", ".pcapng")
_TIMER_HZ = 200.0
"""So that nothing comes later than 5 ms."""


@dataclass(frozen=True, slots=True)
class SourceOptions:
    """What is played. metadata: of an Ouster's pcap. topic: of a recording of ROS. None: found by themselves."""

    path: Path
    metadata: Path | None = None
    topic: str | None = None


def source_builder(sensor: str, options: SourceOptions) -> Callable[[Config, Context], Node]:
    """The builder of the node that plays a recording in the place of a sensor."""

    def build(config: Config, context: Context) -> Node:
        settings = config.sensors.named().get(sensor)
        if settings is None:
            raise ConfigError([f"sensors: no sensor {sensor}; there are {', '.join(config.sensors.named())}"])
        recording = _recording(options, settings.kind, settings.frame, os.environ)
        is_mapped = sensor == "lidar"  # whose scans the mapper takes
        playback = SourcePlayback(options.path.name, sensor, recording, world_of_map if is_mapped else None)
        channels = sensor_channels(sensor)
        return Node(
            name=sensor,
            outputs=(*channels, *([TF_STATIC] if is_mapped else [])),
            on_timer=lambda: playback.due(context.clock_ns(), is_wanted=context.is_wanted(channels[0])),
            timer_hz=_TIMER_HZ,
            is_done=lambda: playback.is_done,
            on_stop=playback.close,
        )

    return build


def _recording(options: SourceOptions, kind: str, frame: str, environment: Mapping[str, str]) -> Recording:
    if options.path.suffix not in _PACKETS:
        if options.metadata is not None:
            raise InputFileError(f"{options.path}: --metadata belongs to a pcap")
        return read_bag(options.path, kind, options.topic, frame)
    if kind != "lidar" or options.topic is not None:
        raise InputFileError(f"{options.path}: a pcap is of a lidar, and has no topics")
    python = Path(environment.get(PYTHON_VARIABLE) or DEFAULT_PYTHON)
    return read_pcap(options.path, options.metadata or metadata_of(options.path), python, frame)
