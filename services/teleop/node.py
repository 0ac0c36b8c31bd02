"""Wiring of the page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from services.teleop.bodies import bodies_of
from services.teleop.page import Page
from services.teleop.player import PlayerProcess
from services.teleop.postures import read_postures
from services.teleop.sliders import joint_scales
from services.teleop.teleop import Teleop
from shared.climbing.steel import SteelSurface
from shared.messaging import channels as c
from shared.messaging.messages import JOINT_NAMES, Message, RobotDescription, StructureDescription
from shared.robot.configured import robot_urdf
from shared.robot.limits import joint_bounds
from shared.robot.urdf import parse_urdf
from shared.runtime.config import Config
from shared.runtime.node import Context, Messages, Node
from shared.world.files import load_structure

_TIMER_HZ = 50.0
"""How soon a press becomes a command, the stop above all."""


def build_node(arguments: Sequence[str], config: Config, context: Context) -> Node:
    """The node behind the page. arguments: what a player that is started here gets, too.

    Raises:
        InputFileError, ConfigError: a file is not usable. PortError: the page's port is taken.
    """
    model = parse_urdf(robot_urdf(config), str(config.robot))
    lower, upper = joint_bounds(model)
    max_velocity = np.array([model.limits[name].velocity for name in JOINT_NAMES])
    postures = read_postures(config.teleop.postures, lower, upper)
    trajectories = {path.stem: path for path in sorted(config.player.trajectory.parent.glob("*.csv"))}
    steel = SteelSurface(load_structure(config.structure))
    teleop = Teleop(config.teleop, max_velocity, postures, list(trajectories))
    player = PlayerProcess(trajectories, arguments)
    page = Page(config, joint_scales(lower, upper), list(postures), list(trajectories), steel)

    def on_timer() -> Messages:
        now_s = context.clock_ns() / 1e9
        messages = [message for press in page.take() for message in teleop.press(press, now_s)]
        messages += teleop.tick(now_s)
        if (ending := player.follow(teleop.trajectory)) is not None:
            teleop.end_trajectory(ending)
        page.show(teleop, now_s)
        return messages

    def on_stop() -> Messages:
        page.close()
        player.stop()
        return teleop.close()

    def draw_robot(robot: RobotDescription) -> list[Message]:
        page.scene.draw_robot(bodies_of(robot.urdf, c.ROBOT_DESCRIPTION.key))
        return []

    def draw_structure(structure: StructureDescription) -> list[Message]:
        page.scene.draw_structure(bodies_of(structure.urdf, c.STRUCTURE_DESCRIPTION.key))
        return []

    noted = (
        c.JOINTS_STATE,
        c.LEG_STATE,
        c.FOOT_STATUS,
        c.TF,
        c.CLOCK,
        c.LIDAR_POINTS,
        c.MAP_CLOUD,
        c.MAP_PLANES,
        c.MAP_STATUS,
        c.EVAL_METRICS,
        c.RECORDER_STATUS,
    )
    return Node(
        name="teleop",
        inputs={
            **dict.fromkeys(noted, teleop.note),
            c.TF_STATIC: teleop.note_static,
            c.EVENTS: teleop.add_event,
            c.HEALTH: teleop.add_health,
            c.ROBOT_STOP: teleop.add_stop,
            c.ROBOT_DESCRIPTION: draw_robot,
            c.STRUCTURE_DESCRIPTION: draw_structure,
        },
        outputs=(c.JOINTS_TARGET, c.LEG_TARGET, c.SIM_CONTROL, c.RECORDER_CONTROL, c.ROBOT_STOP),
        on_timer=on_timer,
        on_stop=on_stop,
        timer_hz=_TIMER_HZ,
    )
