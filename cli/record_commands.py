"""`hyrecro record`: start and stop recordings of a running pipeline, and see what became of each channel."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, JsonOption, SetOption, resolved
from shared.errors import BusError
from shared.runtime.exit_codes import Exit

if TYPE_CHECKING:
    from shared.messaging.messages import RecorderControl, RecorderStatus

app = typer.Typer(no_args_is_help=True)

_TIMEOUT_S = 30.0
"""A stop waits until what is queued is on the disk."""


@app.command()
def start(
    channels: Annotated[
        list[str] | None, typer.Argument(help="Patterns of keys, such as 'lidar/*'; default: recorder.channels.")
    ] = None,
    run: Annotated[str, typer.Option(help="Name of the folder; default: the UTC time.")] = "",
    config: ConfigOption = DEFAULT_CONFIG,
    set_: SetOption = None,
    is_json: JsonOption = False,
) -> None:
    """Begins a new recording."""
    from shared.messaging.messages import RecorderAction, RecorderControl

    control = RecorderControl(action=RecorderAction.START, run=run, channels=tuple(channels or ()))
    _show(_status_after(control, config, set_), is_json=is_json)


@app.command()
def stop(config: ConfigOption = DEFAULT_CONFIG, set_: SetOption = None, is_json: JsonOption = False) -> None:
    """Completes the recording; exit code 3 if it lacks something."""
    from shared.messaging.messages import RecorderAction, RecorderControl

    status = _status_after(RecorderControl(action=RecorderAction.STOP), config, set_)
    _show(status, is_json=is_json)
    if _num_lost(status) or status.text:
        raise typer.Exit(Exit.PARTIAL)


@app.command()
def status(config: ConfigOption = DEFAULT_CONFIG, set_: SetOption = None, is_json: JsonOption = False) -> None:
    """Shows what is being recorded, and by channel what was published, received, written and lost."""
    _show(_status_after(None, config, set_), is_json=is_json)


def _status_after(control: RecorderControl | None, config: Path, set_: list[str] | None) -> RecorderStatus:
    from shared.messaging.bus import Bus
    from shared.messaging.channels import RECORDER_CONTROL, RECORDER_STATUS
    from shared.messaging.messages import RecorderStatus

    settings = resolved(config, set_).bus
    with Bus(settings) as bus:
        if control is not None:
            bus.command(RECORDER_CONTROL, control, _TIMEOUT_S)
        status = bus.ask(RECORDER_STATUS, RecorderStatus)
    if status is None:
        raise BusError(f"no recorder answers at {settings.endpoint}")
    return status


def _num_lost(status: RecorderStatus) -> int:
    return sum(record.num_lost_on_bus + record.num_lost_to_disk for record in status.channels)


def _show(status: RecorderStatus, *, is_json: bool) -> None:
    from shared.messaging.codec import to_jsonable

    if is_json:
        typer.echo(json.dumps({**to_jsonable(status), "num_lost": _num_lost(status)}))
        return
    if not status.path:
        typer.echo(f"nothing is being recorded; {status.free_bytes / 1e9:.1f} GB are free")
        return
    doing = "recording" if status.is_recording else "recorded"
    files = f" and {status.num_files - 1} files before it" if status.num_files > 1 else ""
    typer.echo(f"{doing} {status.path}{files}: {status.num_bytes / 1e6:.1f} MB, {status.free_bytes / 1e9:.1f} GB free")
    if status.text:
        typer.echo(f"stopped: {status.text}")
    if status.channels:
        _show_channels(status)


def _show_channels(status: RecorderStatus) -> None:
    from rich.console import Console
    from rich.table import Table

    columns = ("published", "received", "written", "lost on the bus", "lost to disk")
    table = Table("channel", *columns, box=None, pad_edge=False)
    for column in table.columns[1:]:
        column.justify = "right"
    for record in status.channels:
        published = "-" if record.num_published is None else record.num_published
        counts = (published, record.num_received, record.num_written, record.num_lost_on_bus, record.num_lost_to_disk)
        table.add_row(record.key, *map(str, counts))
    Console(width=110).print(table)
