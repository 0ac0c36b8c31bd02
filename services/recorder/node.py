"""Wiring of the recorder: every recorded channel into files, without loss, and what it says of them."""

from collections.abc import Callable, Mapping
from functools import partial
from importlib.metadata import version
from typing import Any

from services.recorder.recorder import Recorder
from services.recorder.ros.schemas import prepare
from services.recorder.state import RecorderState
from shared.messaging.channels import RECORDER_CONTROL, RECORDER_STATUS, Channel, channels_of
from shared.runtime.config import Config
from shared.runtime.config_loading import dump_config
from shared.runtime.exit_codes import Exit
from shared.runtime.node import Context, Memory, Messages, Node, Part


def build_node(config: Config, _context: Context) -> Node:
    """The node that records what the channel table marks, of every sensor that is configured.

    It subscribes to what `recorder.channels` names and no more: between hosts the rest would fill the link.
    """
    metadata = {"version": version("hyrecro"), "seed": str(config.seed), "config": dump_config(config)}
    recorder = Recorder(config.recorder, metadata, channels_of(config.sensors.others), config.bus.namespace)
    for channel in recorder.channels:
        prepare(channel.ros_type)  # before anything waits in the inbox
    inputs: Mapping[Channel, Callable[[Any], Messages]] = {
        channel: partial(recorder.add, channel) for channel in recorder.channels
    }
    return Node(
        name="recorder",
        inputs={**inputs, RECORDER_CONTROL: recorder.control},
        outputs=(RECORDER_STATUS,),
        on_start=recorder.start,
        on_timer=recorder.tick,
        timer_hz=1.0,
        on_stop=recorder.close,
        is_observer=True,
        answers=(RECORDER_CONTROL,),
        num_lost=recorder.num_lost_to_disk,
        memory=Memory(
            {"state": Part(RecorderState, recorder.snapshot)}, lambda states: recorder.restore(states["state"])
        ),
        exit_code=lambda: Exit.PARTIAL if recorder.has_lost else Exit.FINE,
    )
