"""`hyrecro certs`: credentials for a secure bus, and until when they hold."""

from __future__ import annotations

import os
from datetime import timedelta
from pathlib import Path
from typing import Annotated

import typer

from cli.options import JsonOption
from shared.runtime.exit_codes import Exit

app = typer.Typer(no_args_is_help=True)


@app.command()
def new(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="A new or empty folder.")],
    host: Annotated[
        list[str] | None,
        typer.Option(help="How clients call the router: a name or address. localhost, 127.0.0.1 and router always."),
    ] = None,
    days: Annotated[int, typer.Option(min=1, max=3650, help="How long they hold.")] = 30,
) -> None:
    """Makes a test authority and what it certifies: the router in DIR/router, and a file a role, DIR/<role>.json5."""
    from cli.certificates import Authority, credential_files, now_utc
    from shared.errors import InputFileError
    from shared.runtime.roles import ROLES

    now = now_utc()
    try:
        files = credential_files(Authority(now, now + timedelta(days=days)), ROLES, host or ())
    except ValueError as error:
        raise InputFileError(f"--host: {error}") from error
    try:
        write_files(directory, files)
    except OSError as error:
        raise InputFileError(f"{error.filename}: {error.strerror}") from error
    typer.echo(f"{len(ROLES)} roles and the router, until {now + timedelta(days=days):%Y-%m-%d}: {directory}")


@app.command()
def show(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="The folder, or one file in it.")],
    is_json: JsonOption = False,
) -> None:
    """Lists whom each file is for and until when it holds; exit code 1 if one has expired."""
    import json

    from cli.certificates import holder_of, now_utc
    from shared.errors import InputFileError

    now, rows = now_utc(), []
    for path in _certificates(directory):
        try:
            holder = holder_of(path.read_bytes())
        except OSError as error:
            raise InputFileError(f"{path}: {error.strerror}") from error
        except (ValueError, KeyError, TypeError, IndexError) as error:
            raise InputFileError(f"{path}: neither a PEM certificate nor a file of `hyrecro certs new`") from error
        rows.append((path, holder, holder.days_left(now)))
    if is_json:
        listed = [
            {"file": str(path), "name": holder.name, "hosts": holder.hosts, "until": holder.not_after.isoformat()}
            for path, holder, _ in rows
        ]
        typer.echo(json.dumps({"certificates": listed, "num_expired": sum(days <= 0 for *_, days in rows)}))
    else:
        for path, holder, days in rows:
            state = f"{days:.0f} days left" if days > 0 else "EXPIRED"
            hosts = f" for {', '.join(holder.hosts)}" if holder.hosts else ""
            typer.echo(f"{holder.not_after:%Y-%m-%d %H:%M} UTC  {state:>14}  {holder.name:16} {path}{hosts}")
    if any(days <= 0 for *_, days in rows):
        raise typer.Exit(Exit.FAILED)


def write_files(directory: Path, files: dict[Path, bytes]) -> None:
    """New files that their owner alone can read, in folders that their owner alone can enter.

    Raises:
        OSError: one of them exists, or cannot be written.
    """
    from shared.errors import InputFileError

    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise InputFileError(f"{directory}: must be a new or an empty folder; nothing is overwritten")
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    for path, content in files.items():
        (directory / path).parent.mkdir(mode=0o700, exist_ok=True)
        descriptor = os.open(directory / path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(descriptor, "wb") as file:
            file.write(content)


def _certificates(path: Path) -> list[Path]:
    from shared.errors import InputFileError

    if not path.is_dir():
        return [path]
    found = [*sorted(path.glob("router/*.pem")), *sorted(path.glob("*.json5"))]
    if not found:
        raise InputFileError(f"{path}: no credentials here; `hyrecro certs new {path}` makes them")
    return found
