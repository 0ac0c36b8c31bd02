"""`hyrecro config`: show or check the resolved configuration."""

from __future__ import annotations

import json

import typer

from cli.options import DEFAULT_CONFIG, ConfigOption, JsonOption, SetOption, resolved

app = typer.Typer(no_args_is_help=True)


@app.command()
def show(config: ConfigOption = DEFAULT_CONFIG, set_: SetOption = None, is_json: JsonOption = False) -> None:
    """Prints every setting as it results from file, environment and flags."""
    from shared.runtime.config_loading import dump_config

    settings = resolved(config, set_)
    typer.echo(json.dumps(settings.model_dump(mode="json"), indent=2) if is_json else dump_config(settings), nl=is_json)


@app.command()
def check(config: ConfigOption = DEFAULT_CONFIG, set_: SetOption = None) -> None:
    """Says every problem of a configuration at once; exit code 2 if there is one."""
    resolved(config, set_)
    typer.echo(f"{config}: fine")
