"""Who sends and who takes what: asked of the services' own nodes."""

from __future__ import annotations

import socket
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

from cli import announcer
from services.evaluator import node as evaluator
from services.mapper import node as mapper
from services.planner import node as planner
from services.player import node as player
from services.recorder import node as recorder
from services.sensors import node as sensors
from services.sim import node as sim
from services.teleop import node as teleop
from services.viewer import node as viewer
from services.viewer.live import LiveView
from shared.messaging.channels import CHANNELS, EVENTS, HEALTH, LEG_STATE
from shared.runtime.config import Config
from shared.runtime.config_loading import load_config
from shared.runtime.node import Context, Node
from shared.runtime.runner import BuildNode

PEOPLE = "people, programs"


@dataclass(frozen=True, slots=True)
class Wires:
    """One service, or the people who command it, the keys it sends and takes, and the commands that it answers."""

    name: str
    sends: frozenset[str]
    takes: frozenset[str]
    answers: frozenset[str] = frozenset()


@cache
def all_wires() -> tuple[Wires, ...]:
    """Everybody, in the order in which data flow. The mapper takes what it takes of either sensor."""
    commands = frozenset(channel.key for channel in CHANNELS if channel.is_command)
    everyone = [Wires(PEOPLE, commands, frozenset())]
    for name, build in _builders().items():
        inputs = ("lidar", "depth") if name == "mapper" else ("lidar",)
        nodes = [_built(build, f"mapper.input={sensor}") for sensor in inputs]
        sent = {channel.key for node in nodes for channel in node.outputs} | {EVENTS.key, HEALTH.key}
        everyone.append(Wires(name, frozenset(sent), frozenset(_inputs(nodes)), frozenset(_answers(nodes))))
    return (*everyone, Wires(announcer.NAME, frozenset({EVENTS.key, HEALTH.key}), frozenset({LEG_STATE.key})))


def _builders() -> dict[str, BuildNode]:
    def sensor(name: str) -> BuildNode:
        return lambda config, context: sensors.build_node(name, config, context)

    return {
        "teleop": lambda config, context: teleop.build_node((), config, context),
        "player": player.build_node,
        "planner": planner.build_node,
        "sim": sim.build_node,
        "lidar": sensor("lidar"),
        "depth": sensor("depth"),
        "mapper": mapper.build_node,
        "evaluator": evaluator.build_node,
        "recorder": recorder.build_node,
        "viewer": lambda config, _context: viewer.node_of(LiveView(lambda _drawn: None), config, lambda: True),
    }


def _inputs(nodes: Iterable[Node]) -> set[str]:
    return {channel.key for node in nodes for channel in node.inputs}


def _answers(nodes: Iterable[Node]) -> set[str]:
    """Observers leave commands to others to answer, but those that they name."""
    return {
        channel.key
        for node in nodes
        for channel in (node.answers if node.is_observer else node.inputs)
        if channel.is_command
    }


def _built(build: BuildNode, override: str) -> Node:
    with tempfile.TemporaryDirectory() as folder:
        config: Config = load_config(
            overrides=[override, f"recorder.directory={folder}", f"teleop.port={_free_port()}"]
        )
        node = build(config, Context(clock_ns=lambda: 0))
        node.on_stop()
    return node


def _free_port() -> int:
    """For the page, which listens as soon as it is built."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])
