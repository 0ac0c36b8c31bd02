"""Wiring of the recorder: every recorded channel into one file, without loss."""

from functools import partial
from importlib.metadata import version

from services.recorder.layout import write_layout
from services.recorder.recorder import Recorder
from shared.messaging.channels import channels_of
from shared.runtime.config import Config
from shared.runtime.config_loading import dump_config
from shared.runtime.node import Context, Node
from shared.runtime.run_folder import make_run_folder, run_name


def build_node(config: Config, _context: Context) -> Node:
    """The node that records everything the channel table marks, of every sensor that is configured."""
    folder = make_run_folder(config.recorder, run_name(config.recorder))
    metadata = {"version": version("hyrecro"), "seed": str(config.seed), "config": dump_config(config)}
    write_layout(folder / "layout", folder / "run.mcap")
    channels = channels_of(config.sensors.others)
    recorder = Recorder(config.recorder, folder / "run.mcap", metadata, channels)
    return Node(
        name="recorder",
        inputs={channel: partial(recorder.add, channel) for channel in channels if channel.is_recorded},
        on_timer=recorder.flush,
        timer_hz=1.0 / config.recorder.chunk_period_s,
        on_stop=recorder.close,
        is_observer=True,
    )
