"""Wiring of the simulation."""

from services.sim.climbing_sim import ClimbingSim
from services.sim.state import SimState
from shared.messaging.channels import (
    ACTUATORS_STATE,
    ACTUATORS_TARGET,
    CLOCK,
    FIXED_FOOT_DESCRIPTION,
    JOINTS_STATE,
    JOINTS_TARGET,
    LEG_STATE,
    LEG_TARGET,
    ROBOT_DESCRIPTION,
    ROBOT_STOP,
    SIM_CONTROL,
    STRUCTURE_DESCRIPTION,
    TF,
)
from shared.robot.configured import robot_urdf
from shared.robot.urdf import read_urdf
from shared.runtime.config import Config
from shared.runtime.node import Context, Memory, Messages, Node, Part
from shared.world.files import load_structure


def load_sim(config: Config) -> ClimbingSim:
    """The simulation of a configuration's robot on its structure.

    Raises:
        InputFileError, ConfigError: one of the files is not usable, or a sensor cannot be mounted.
    """
    return ClimbingSim(
        config.sim,
        urdf_text=robot_urdf(config),
        structure=load_structure(config.structure),
        mark_text=read_urdf(config.fixed_foot_mark),
        seed=config.seed,
        source=str(config.robot),
    )


def build_node(config: Config, _context: Context) -> Node:
    """The node that moves the robot and owns simulated time."""
    sim = load_sim(config)

    def stop() -> Messages:
        sim.close()
        return ()

    return Node(
        name="sim",
        inputs={
            JOINTS_TARGET: sim.set_joint_target,
            LEG_TARGET: sim.set_fixed_foot,
            ACTUATORS_TARGET: sim.set_actuator_target,
            SIM_CONTROL: sim.control,
            ROBOT_STOP: sim.stop,
        },
        outputs=(
            JOINTS_STATE,
            ACTUATORS_STATE,
            LEG_STATE,
            TF,
            CLOCK,
            ROBOT_DESCRIPTION,
            FIXED_FOOT_DESCRIPTION,
            STRUCTURE_DESCRIPTION,
        ),
        on_start=sim.start,
        on_timer=sim.step,
        on_stop=stop,
        timer_hz=lambda: sim.wall_hz,
        memory=Memory({"state": Part(SimState, sim.snapshot)}, lambda states: sim.restore(states["state"])),
    )
