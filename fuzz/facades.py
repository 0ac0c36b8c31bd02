"""The nodes of all services in one process, to be fed with payloads as the runner feeds them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from time import monotonic_ns

import numpy as np

from services.evaluator.node import build_node as evaluator_node
from services.mapper.node import build_node as mapper_node
from services.planner.node import build_node as planner_node
from services.player.node import build_node as player_node
from services.recorder.bag.recorded import RecordingReader
from services.recorder.node import build_node as recorder_node
from services.recorder.replay.node import replay_node
from services.recorder.replay.replay import Replay, ReplayOptions
from services.sensors.node import build_node as sensor_node
from services.sim.node import build_node as sim_node
from services.teleop.bodies import bodies_of
from services.teleop.teleop import Teleop
from services.viewer.drawing import Drawn
from services.viewer.live import LiveView
from services.viewer.node import node_of as viewer_node
from shared.messaging import channels as c
from shared.messaging.channels import Channel
from shared.messaging.messages import Message
from shared.runtime.config import Config
from shared.runtime.config_loading import load_config
from shared.runtime.node import Addressed, Context, Messages, Node
from tests.support.recordings import write_recording

_NS = 10**9


def build(name: str, folder: Path, context: Context | None = None) -> Node:
    """One of `SERVICES`, the simulation in both modes; recordings go into the folder."""
    mode = "dynamic" if name == "sim_dynamic" else "kinematic"
    config = load_config(overrides=[f"recorder.directory={folder}", f"sim.mode={mode}"])
    return SERVICES[name](config, context or Context(clock_ns=monotonic_ns))


def said_by(sim: Node, lidar: Node, num_steps: int = 30) -> Iterator[tuple[Channel, Message]]:
    """What a simulation and a LiDAR say at their begin: from it the others know robot, structure and stance."""
    waiting = [*_addressed(sim, sim.on_start())]
    for _ in range(num_steps):
        waiting += _addressed(sim, sim.on_timer())
    for channel, message in waiting:
        yield channel, message
        if channel in lidar.inputs:
            yield from _addressed(lidar, lidar.inputs[channel](message))


def _addressed(node: Node, messages: Messages) -> Iterator[tuple[Channel, Message]]:
    routes = {channel.message: channel for channel in node.outputs}
    for said in messages:
        if isinstance(said, Addressed):
            yield said.channel, said.message
        elif type(said) in routes:
            yield routes[type(said)], said


def _replay(config: Config, context: Context) -> Node:
    path = config.recorder.directory / "replayed.mcap"
    channels = (c.ROBOT_DESCRIPTION, c.CLOCK, c.LIDAR_POINTS)
    write_recording(path)
    options = ReplayOptions(
        first_ns=0, last_ns=3 * _NS, start_ns=0, end_ns=3 * _NS, channels={channel: channel for channel in channels}
    )
    replay = Replay(options, lambda: RecordingReader(path, channels.__contains__).messages())
    return replay_node(replay, channels, context, is_lockstep=False)


def _throw_away(drawings: Iterable[Drawn]) -> None:
    for _ in drawings:
        pass


def _viewer(config: Config, _context: Context) -> Node:
    """What it draws is made and thrown away."""
    return viewer_node(LiveView(_throw_away), config, lambda: False)


def _teleop(config: Config, _context: Context) -> Node:
    """Without its page."""
    teleop = Teleop(config.teleop, np.full(8, 0.5), {"zero": np.zeros(8)}, ["climb"])
    noted = (c.JOINTS_STATE, c.LEG_STATE, c.FOOT_STATUS, c.TF, c.CLOCK, c.LIDAR_POINTS, c.MAP_CLOUD, c.MAP_PLANES)
    described = (c.ROBOT_DESCRIPTION, c.STRUCTURE_DESCRIPTION)

    def drawn(key: str, description: Message) -> Messages:
        bodies_of(description.urdf, key)  # type: ignore[attr-defined]
        return []

    return Node(
        name="teleop",
        inputs={
            **dict.fromkeys((*noted, c.MAP_STATUS, c.EVAL_METRICS, c.RECORDER_STATUS), teleop.note),
            **{channel: partial(drawn, channel.key) for channel in described},
            c.TF_STATIC: teleop.note_static,
            c.EVENTS: teleop.add_event,
            c.HEALTH: teleop.add_health,
            c.ROBOT_STOP: teleop.add_stop,
        },
        outputs=(c.JOINTS_TARGET, c.LEG_TARGET, c.SIM_CONTROL, c.RECORDER_CONTROL, c.ROBOT_STOP),
    )


SERVICES: dict[str, Callable[[Config, Context], Node]] = {
    "sim": sim_node,
    "sim_dynamic": sim_node,
    "planner": planner_node,
    "player": player_node,
    "recorder": recorder_node,
    "replay": _replay,
    "lidar": partial(sensor_node, "lidar"),
    "depth": partial(sensor_node, "depth"),
    "mapper": mapper_node,
    "evaluator": evaluator_node,
    "teleop": _teleop,
    "viewer": _viewer,
}
