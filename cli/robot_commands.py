"""`hyrecro robot`: command the robot and read its state."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, JsonOption, SetOption, resolved

if TYPE_CHECKING:
    from shared.messaging.bus import Bus
    from shared.messaging.messages import Transforms

app = typer.Typer(no_args_is_help=True)


@app.command()
def play(
    trajectory: Annotated[Path, typer.Argument(metavar="FILE.csv", help="Header q1..q8; a target or C,...,C a row.")],
    rate: Annotated[float | None, typer.Option(help="Commands a second of simulated time; default 9.")] = None,
    steps: Annotated[int | None, typer.Option(help="Commands a row; default 100.")] = None,
    speed: Annotated[float | None, typer.Option(help="Instead of steps: rad/s of the longest way.")] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Plays a trajectory file on the running robot, and waits until it has reached every target."""
    from cli.playback import play_trajectory
    from shared.runtime.stop_signal import StopSignal

    overrides = [f"player.trajectory={trajectory.resolve()}", *(set_ or [])]
    overrides += [f"player.rate_hz={rate}"] if rate is not None else []
    overrides += [f"player.num_steps={steps}", "player.speed_radps=null"] if steps is not None else []
    overrides += [f"player.speed_radps={speed}"] if speed is not None else []
    stop = StopSignal()
    is_finished = play_trajectory(resolved(config, overrides), stop.is_set)
    if not is_finished:
        raise typer.Exit(stop.exit_code())


@app.command(context_settings={"ignore_unknown_options": True})  # or -0.6 would be taken for an option
def joints(
    q: Annotated[list[float], typer.Argument(help="q1..q8 in radians, q2 and q7 in metres.")],
    duration: Annotated[float | None, typer.Option(help="Seconds the motion shall take.")] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Sends a joint target; exit code 1 with the reason if the robot refuses it."""
    from shared.messaging.bus import Bus
    from shared.messaging.channels import JOINTS_TARGET
    from shared.messaging.messages import JointTarget

    with Bus(resolved(config, set_).bus) as bus:
        bus.command(JOINTS_TARGET, JointTarget(q=q, duration_s=duration))  # type: ignore[arg-type]
    typer.echo("accepted")


@app.command()
def stop(
    reason: Annotated[str, typer.Argument(help="What others shall read.")] = "hyrecro robot stop",
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Halts every drive where it is, at once; a step or a trajectory under way ends."""
    from shared.messaging.bus import Bus
    from shared.messaging.channels import ROBOT_STOP
    from shared.messaging.messages import Stop

    with Bus(resolved(config, set_).bus) as bus:
        bus.command(ROBOT_STOP, Stop(text=reason))
    typer.echo("accepted")


@app.command()
def leg(
    foot: Annotated[str, typer.Argument(metavar="A|B", help="The foot that shall be fixed.")],
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Changes the fixed foot; exit code 1 with the reason if the robot refuses."""
    from shared.messaging.bus import Bus
    from shared.messaging.channels import LEG_TARGET
    from shared.messaging.messages import Foot, LegTarget

    if foot not in Foot.__members__:
        raise typer.BadParameter(f"{foot!r} is not a foot: A or B")
    with Bus(resolved(config, set_).bus) as bus:
        bus.command(LEG_TARGET, LegTarget(foot=Foot(foot)))
    typer.echo("accepted")


@app.command()
def step(
    foot: Annotated[
        str | None, typer.Argument(metavar="[A|B]", help="The foot to put there; default the free one.")
    ] = None,
    point: Annotated[tuple[float, float, float] | None, typer.Option(help="On the steel, in metres.")] = None,
    normal: Annotated[tuple[float, float, float] | None, typer.Option(help="Out of the steel there.")] = None,
    pose: Annotated[
        tuple[float, float, float, float, float, float, float] | None,
        typer.Option(metavar="X Y Z QX QY QZ QW", help="Of the foot plate's centre, instead of point and normal."),
    ] = None,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Puts a foot on steel and waits until it stands there; exit code 1 with the reason if it does not get there.

    Example: hyrecro robot step --point 0 -0.35 10.1 --normal 0 0 1
    """
    from cli.stepping import step_foot
    from shared.errors import MessageError
    from shared.messaging.messages import Foot, FootTarget
    from shared.runtime.stop_signal import StopSignal

    if foot is not None and foot not in Foot.__members__:
        raise typer.BadParameter(f"{foot!r} is not a foot: A or B")
    try:
        wanted = None if foot is None else Foot(foot)
        target = FootTarget(foot=wanted, T_world_foot=pose, point_m=point, normal=normal)  # type: ignore[arg-type]
    except MessageError as error:
        raise typer.BadParameter(f"{error} (--pose, or --point and --normal)") from error
    stop = StopSignal()
    landed = step_foot(resolved(config, set_), target, stop.is_set)
    if landed is None:
        raise typer.Exit(stop.exit_code())
    typer.echo(f"foot {landed.value} stands")


@app.command()
def check(
    trajectory: Annotated[Path, typer.Argument(metavar="FILE.csv", help="Header q1..q8; a target or C,...,C a row.")],
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
    is_json: JsonOption = False,
) -> None:
    """Judges a trajectory file row by row, without a robot; exit code 3 where a row is bad.

    Joint limits, cuts into steel or itself on the way (at most 1 mm), landings (0.5 mm, 0.5 deg, the whole sole over
    steel), and what the magnets hold.
    """
    from cli.trajectory_check import check_trajectory, print_reports

    raise typer.Exit(print_reports(check_trajectory(trajectory, resolved(config, set_)), is_json=is_json))


@app.command()
def state(config: ConfigOption = DEFAULT_CONFIG, set_: SetOption = None, is_json: JsonOption = False) -> None:
    """Prints joints, fixed foot, pose of the hip and the services that are alive; exit code 1 without a robot."""
    from shared.messaging.bus import Bus

    with Bus(resolved(config, set_).bus) as bus:
        now = _state(bus)
    if is_json:
        typer.echo(json.dumps(now))
    else:
        _print_state(now)
    if now["q"] is None:
        raise typer.Exit(1)


def _state(bus: Bus) -> dict[str, Any]:
    from shared.messaging.channels import ACTUATORS_STATE, CLOCK, JOINTS_STATE, LEG_STATE, TF
    from shared.messaging.messages import ActuatorState, Clock, JointState, LegState, Transforms

    joints_state = bus.ask(JOINTS_STATE, JointState)
    leg_state = bus.ask(LEG_STATE, LegState)
    transforms = bus.ask(TF, Transforms)
    actuators = bus.ask(ACTUATORS_STATE, ActuatorState)
    clock = bus.ask(CLOCK, Clock)
    return {
        "stamp_s": None if joints_state is None else joints_state.stamp_ns / 1e9,
        "real_time_factor": None if clock is None else clock.real_time_factor,
        "q": None if joints_state is None else joints_state.q.tolist(),
        "actuators": None if actuators is None else actuators.positions.tolist(),
        "fixed_foot": None if leg_state is None else leg_state.fixed_foot.value,
        "has_contact": None if leg_state is None else leg_state.has_contact,
        "holding": None if leg_state is None or leg_state.holding is None else [f.value for f in leg_state.holding],
        "margin": None if leg_state is None else leg_state.margin,
        "hip_xyz_quat_xyzw": None if transforms is None else _hip_pose(transforms),
        "services": sorted(bus.alive()),
    }


def _hip_pose(transforms: Transforms) -> list[float]:
    """x y z qx qy qz qw of the hip plate's centre in the world."""
    from shared.messaging.frames import FrameTree
    from shared.robot.kinematics import HYRECRO

    pose: list[float] = (FrameTree(transforms).T_root("hip") @ HYRECRO.T_hip_plate).xyz_quat_xyzw.tolist()
    return pose


def _print_state(now: dict[str, Any]) -> None:
    if now["q"] is None:
        print("no simulation answers", file=sys.stderr)
    else:
        pose = now["hip_xyz_quat_xyzw"]
        pace = "paused" if now["real_time_factor"] == 0 else f"{now['real_time_factor']:g} s a second"
        typer.echo(f"time        {now['stamp_s']:.2f} s, {pace}")
        typer.echo("joints      " + "  ".join(f"q{i} {value:+.4f}" for i, value in enumerate(now["q"], start=1)))
        holding = " and ".join(now["holding"] or []) or "nothing"
        margin = "" if now["margin"] is None else f", margin {now['margin']:.2f}"
        contact = "on steel" if now["has_contact"] else "not on steel"
        typer.echo(f"fixed foot  {now['fixed_foot']}, {contact}; holding: {holding}{margin}")
        typer.echo("hip         x {:+.4f}  y {:+.4f}  z {:+.4f} m   q {:+.4f} {:+.4f} {:+.4f} {:+.4f}".format(*pose))
    typer.echo("services    " + (" ".join(now["services"]) or "none"))
