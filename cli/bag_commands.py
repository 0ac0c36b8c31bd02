"""`hyrecro bag`: what a recording holds, whether all of it is there, and what can be made of it."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from cli.options import JsonOption

app = typer.Typer(no_args_is_help=True)

RecordingArgument = Annotated[Path, typer.Argument(metavar="RUN.mcap", help="A recording, also one that was cut off.")]
RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN.mcap|FOLDER", help="A recording, or the folder of a run: all its files.")
]
Target = Literal["rosbag2", "pcd", "ply", "las"]


@app.command()
def info(recording: RunArgument, is_json: JsonOption = False) -> None:
    """Shows what a recording holds, and what it says of its own losses; exit code 3 where it is INCOMPLETE."""
    from cli.bag_tables import info_json, print_info
    from services.recorder.bag.overview import overview_of
    from services.recorder.tally import COMPLETE

    if recording.is_dir():
        _end(is_fine=_balance(recording, is_json))
    with _progress("read") as on_progress:
        overview = overview_of(recording, on_progress)
    _say(info_json(overview), is_json, lambda: print_info(overview))
    _end(is_fine=overview.state == COMPLETE)


@app.command()
def verify(recording: RunArgument, is_json: JsonOption = False) -> None:
    """Decodes every message, checks checksums, numbers and stamps; exit code 3 where something is missing."""
    from cli.bag_tables import print_verification, verification_json
    from services.recorder.bag.verification import verified

    if recording.is_dir():
        _end(is_fine=_verified_folder(recording, is_json))
    with _progress("verify") as on_progress:
        verification = verified(recording, on_progress)
    _say(verification_json(verification), is_json, lambda: print_verification(verification))
    _end(is_fine=verification.is_fine)


@app.command()
def recover(
    recording: RecordingArgument,
    out: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="A new file.")],
    is_json: JsonOption = False,
) -> None:
    """Copies every whole chunk of a damaged recording into a new one with an index; exit code 3 where some are lost."""
    from cli.bag_tables import print_recovered, recovered_json
    from services.recorder.bag.recovery import recover as run

    with _progress("recover") as on_progress:
        recovered = run(recording, out, on_progress)
    _say(recovered_json(recovered), is_json, lambda: print_recovered(recovered, out))
    _end(is_fine=not recovered.has_losses)


@app.command()
def convert(
    recording: RecordingArgument,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="A new folder.")],
    to: Annotated[Target, typer.Option(help="A rosbag2 folder, or a file a cloud.")] = "rosbag2",
    channel: Annotated[
        str | None, typer.Option(metavar="KEY", help="Of clouds: lidar/points (default), depth/points, map/cloud.")
    ] = None,
    is_json: JsonOption = False,
) -> None:
    """Writes a recording as a rosbag2 folder, or its clouds as data0.pcd ...; exit code 3 where some are missing."""
    from services.recorder.bag.conversion import cloud_channel, to_clouds, to_rosbag2
    from shared.messaging.channels import LIDAR_POINTS

    with _progress("convert") as on_progress:
        if to == "rosbag2":
            converted = to_rosbag2(recording, out, on_progress)
        else:
            converted = to_clouds(recording, out, cloud_channel(channel or LIDAR_POINTS.key), to, on_progress)
    for problem in converted.problems:
        print(f"hyrecro: {recording}: {problem}", file=sys.stderr)
    noun = "messages" if to == "rosbag2" else f"{to} files"
    figures = {"written": converted.num_written, "problems": list(converted.problems)}
    _say(figures, is_json, lambda: typer.echo(f"{converted.num_written} {noun} in {out}"))
    _end(is_fine=not converted.problems)


def _balance(folder: Path, is_json: bool) -> bool:
    """Prints what a run's files hold together; returns whether that is all."""
    from cli.bag_folder_tables import balance_json, print_balance
    from services.recorder.bag.balance import balance_of
    from services.recorder.tally import COMPLETE

    with _progress("read") as on_progress:
        balance = balance_of(folder, on_progress)
    _say(balance_json(balance), is_json, lambda: print_balance(balance))
    return balance.state == COMPLETE


def _verified_folder(folder: Path, is_json: bool) -> bool:
    """Verifies each file of a run, and prints what is missing between them, too; returns whether all is there."""
    from cli.bag_folder_tables import folder_verification_json, print_folder_verification
    from services.recorder.bag.balance import balance_of, run_files
    from services.recorder.bag.verification import verified
    from services.recorder.tally import COMPLETE

    with _progress("verify") as on_progress:
        files = run_files(folder)
        verifications = []
        for number, path in enumerate(files):
            on_progress(number / len(files) / 2)
            verifications.append(verified(path))
        balance = balance_of(folder, lambda share: on_progress(0.5 + share / 2))
    _say(
        folder_verification_json(balance, verifications),
        is_json,
        lambda: print_folder_verification(balance, verifications),
    )
    return balance.state == COMPLETE and all(each.is_fine for each in verifications)


@contextmanager
def _progress(task: str) -> Iterator[Callable[[float], None]]:
    """An unusable recording is no wrong usage: it ends with exit code 1."""
    from cli.playback import progress_bar
    from shared.errors import HyrecroError, InputFileError

    try:
        with progress_bar() as progress:
            task_id = progress.add_task(task, total=1.0)
            yield lambda share: progress.update(task_id, completed=share)
    except InputFileError as error:
        raise HyrecroError(str(error)) from error


def _say(figures: dict[str, Any], is_json: bool, show: Callable[[], None]) -> None:
    if is_json:
        print(json.dumps(figures, indent=2))
    else:
        show()


def _end(*, is_fine: bool) -> None:
    from shared.runtime.exit_codes import Exit

    raise typer.Exit(Exit.FINE if is_fine else Exit.PARTIAL)
