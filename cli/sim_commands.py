"""`hyrecro sim`: pause, step, pace, reset and seed of simulated time."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, SetOption, resolved

app = typer.Typer(no_args_is_help=True)

SeedOption = Annotated[int | None, typer.Option(help="New seed of the simulation's random numbers.")]


@app.command()
def pause(config: ConfigOption = DEFAULT_CONFIG, set_: SetOption = None) -> None:
    """Lets simulated time stand still."""
    _control(config, set_, "pause")


@app.command()
def resume(config: ConfigOption = DEFAULT_CONFIG, set_: SetOption = None) -> None:
    """Lets simulated time run on."""
    _control(config, set_, "resume")


@app.command()
def step(
    num_steps: Annotated[int, typer.Argument(metavar="N", help="Periods of 1 / sim.rate_hz.")] = 1,
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Advances a paused simulation by single periods."""
    _control(config, set_, "step", num_steps=num_steps)


@app.command()
def reset(seed: SeedOption = None, config: ConfigOption = DEFAULT_CONFIG, set_: SetOption = None) -> None:
    """Puts the robot back to its initial place and posture. Time goes on."""
    _control(config, set_, "reset", seed=seed)


@app.command()
def speed(
    factor: Annotated[float, typer.Argument(help="Seconds of simulated time a second, 0.01 to 100.")],
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Sets the pace of simulated time; a machine that is too slow for it falls behind."""
    _control(config, set_, real_time_factor=factor)


@app.command()
def seed(
    seed: Annotated[int, typer.Argument(help="Not negative.")],
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
) -> None:
    """Starts the simulation's random numbers (encoders, slips) anew."""
    _control(config, set_, seed=seed)


def _control(config: Any, set_: list[str] | None, action: str | None = None, **fields: Any) -> None:
    from shared.messaging.bus import Bus
    from shared.messaging.channels import SIM_CONTROL
    from shared.messaging.messages import SimAction, SimControl

    with Bus(resolved(config, set_).bus) as bus:
        bus.command(SIM_CONTROL, SimControl(action=None if action is None else SimAction(action), **fields))
    typer.echo("accepted")
