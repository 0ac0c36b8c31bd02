"""`hyrecro sweep`: maps and scores over methods, voxels, noise and seeds."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from cli.options import DEFAULT_CONFIG, resolved

_TABLE_WIDTH = 150
"""Of the table in letters, also where a terminal is narrower: cut figures are of no use."""


def register(app: typer.Typer) -> None:
    """Adds the command to the top of the command tree."""
    app.command()(sweep)


def sweep(
    spec: Annotated[Path, typer.Argument(metavar="SPEC.yaml", help="Lists of data, methods, voxels, noise, seeds.")],
    out: Annotated[Path | None, typer.Option(help="Folder of the results; default out/sweep_<name of SPEC>.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Cases at a time; default: one a core.")] = None,
) -> None:
    """Runs `map` and `eval` for every combination in SPEC, and writes one table: results.csv and results.md.

    May be stopped and started again: cases that are done are kept. Exit code 3 where a case failed.
    """
    from rich.console import Console

    from cli.playback import progress_bar
    from cli.sweep import Sweep
    from cli.sweep_spec import cases_of, read_spec
    from cli.sweep_table import csv_text, markdown_text, rows_of, terminal_table
    from shared.errors import InputFileError
    from shared.runtime.exit_codes import Exit
    from shared.runtime.stop_signal import StopSignal

    wanted = read_spec(spec)
    settings = resolved(DEFAULT_CONFIG, list(wanted.set_))
    cases = cases_of(wanted, spec.resolve().parent, settings.structure)
    folder = out or settings.recorder.directory / f"sweep_{spec.stem}"
    with StopSignal() as stop, progress_bar() as progress:
        try:
            runs = Sweep(cases, folder, stop.is_set)
        except OSError as error:
            raise InputFileError(f"{folder}: {error.strerror or error}") from error
        task = progress.add_task("sweep", total=len(cases), completed=runs.num_done)

        def note(text: str) -> None:
            print(text, file=sys.stderr)
            progress.update(task, completed=runs.num_done)

        runs.run(jobs or os.cpu_count() or 1, note)
    rows = rows_of(runs.results())
    (folder / "results.csv").write_text(csv_text(rows), encoding="utf-8")
    (folder / "results.md").write_text(markdown_text(rows), encoding="utf-8")
    console = Console(width=max(Console().width, _TABLE_WIDTH))
    if rows:
        console.print(terminal_table(rows))
    console.print(f"{runs.num_done} of {len(cases)} cases in {folder}", soft_wrap=True, highlight=False)
    if stop.is_set():
        raise typer.Exit(stop.exit_code())
    raise typer.Exit(Exit.FINE if runs.num_done == len(cases) else Exit.PARTIAL)
