"""Options that several commands share, and how they become a configuration."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from shared.runtime.config import Config

DEFAULT_CONFIG = Path("default")
Part = Literal["robot", "base"]
"""What runs on one of two hosts, whose routers are joined."""

ConfigOption = Annotated[
    Path, typer.Option("--config", help="Configuration file, or the name of a preset in configs/.")
]
SetOption = Annotated[list[str] | None, typer.Option("--set", metavar="SECTION.KEY=VALUE", help="Changes one setting.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Prints JSON to stdout.")]


def resolved(config: Path, overrides: list[str] | None) -> Config:
    """The configuration of these options and the environment."""
    from shared.runtime.config_loading import load_config  # here, so that --help stays quick

    return load_config(config, overrides or [], os.environ)


def service_arguments(config: Path, overrides: list[str]) -> list[str]:
    """The same options as arguments of a service."""
    return ["--config", str(config), *(part for override in overrides for part in ("--set", override))]
