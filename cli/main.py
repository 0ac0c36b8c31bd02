"""The `hyrecro` command: a file a family of verbs. Heavy modules are imported by the verb that needs them."""

from __future__ import annotations

import signal
import sys
from types import FrameType

import typer

from cli import (
    bag_commands,
    certs_commands,
    cloud_commands,
    config_commands,
    eval_commands,
    map_commands,
    pipeline_commands,
    record_commands,
    replay_commands,
    robot_commands,
    sensor_commands,
    sim_commands,
    structure_commands,
    sweep_commands,
    top_commands,
    view_commands,
)
from shared.errors import ConfigError, HyrecroError, InputFileError, StoppedError
from shared.runtime.exit_codes import Exit

app = typer.Typer(
    help="Simulate, sense, map and record lattice-climbing robots.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
pipeline_commands.register(app)
top_commands.register(app)
map_commands.register(app)
eval_commands.register(app)
sweep_commands.register(app)
replay_commands.register(app)
app.add_typer(bag_commands.app, name="bag", help="Look into recordings, verify, recover and convert them.")
view_commands.register(app)
app.add_typer(cloud_commands.app, name="cloud", help="Find planes in clouds, filter and save them.")
app.add_typer(record_commands.app, name="record", help="Start and stop recordings, and see what they hold.")
app.add_typer(robot_commands.app, name="robot", help="Command the robot and read its state.")
app.add_typer(sensor_commands.app, name="sensor", help="See what the sensors see.")
app.add_typer(sim_commands.app, name="sim", help="Pause, step, pace, reset and seed of simulated time.")
app.add_typer(config_commands.app, name="config", help="Show or check the configuration.")
app.add_typer(certs_commands.app, name="certs", help="Make credentials of a secure bus, and see until when they hold.")
app.add_typer(structure_commands.app, name="structure", help="Make, show and convert structures.")


def main() -> None:
    """Entry point: runs the command and ends with the project's exit codes."""
    signal.signal(signal.SIGINT, _interrupted)
    try:
        app()
    except (ConfigError, InputFileError) as error:
        print(f"hyrecro: {error}", file=sys.stderr)
        sys.exit(Exit.USAGE)
    except StoppedError as error:
        print(f"hyrecro: {error}", file=sys.stderr)
        sys.exit(Exit.PARTIAL)
    except HyrecroError as error:
        print(f"hyrecro: {error}", file=sys.stderr)
        sys.exit(Exit.FAILED)


def _interrupted(_signum: int, _frame: FrameType | None) -> None:
    sys.exit(Exit.INTERRUPTED)


if __name__ == "__main__":
    main()
