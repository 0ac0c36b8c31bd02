"""Wiring of the live view: it listens to everything that has a picture, and says nothing."""

from collections.abc import Callable
from functools import partial

from services.viewer.live import LiveView
from services.viewer.scene import has_picture
from shared.messaging.channels import channels_of
from shared.runtime.config import Config
from shared.runtime.node import Node


def node_of(view: LiveView, config: Config, is_done: Callable[[], bool]) -> Node:
    """The node of one live view, of every sensor that is configured."""
    channels = [channel for channel in channels_of(config.sensors.others) if has_picture(channel)]
    return Node(
        name="viewer",
        inputs={channel: partial(view.show, channel) for channel in channels},
        is_done=lambda: view.is_over or is_done(),
    )
