"""The folder of one run: out/<UTC time>/, with a link `latest` beside it."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path

from shared.errors import InputFileError
from shared.runtime.config import RecorderConfig


def run_name(config: RecorderConfig, robot: str = "") -> str:
    """The configured name of the run, or the UTC time now as 20261122T103300Z.

    robot: its namespace, which then stands behind the time, so that two robots never write into one folder.
    """
    time = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    return config.run or "_".join([time, *filter(None, robot.split("/"))])


def new_run_name(config: RecorderConfig, robot: str = "") -> str:
    """The UTC time now, and a robot's namespace, and a number where there is such a folder already."""
    name = run_name(config.model_copy(update={"run": ""}), robot)
    names = [name, *(f"{name}_{number}" for number in range(2, 100))]
    return next((name for name in names if not run_folder(config, name).exists()), name)


def run_folder(config: RecorderConfig, name: str) -> Path:
    """Where the run of that name is written."""
    return config.directory / name


def make_run_folder(config: RecorderConfig, name: str) -> Path:
    """Makes the folder and lets `latest` point to it.

    Raises:
        InputFileError: it cannot be made.
    """
    folder = run_folder(config, name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        fresh = config.directory / f".latest.{os.getpid()}"
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(name)
        fresh.replace(config.directory / "latest")
    except OSError as error:
        raise InputFileError(f"recorder.directory {config.directory}: {error.strerror or error}") from error
    return folder
