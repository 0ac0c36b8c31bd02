"""The page of commands, from the command tree itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer

from cli.main import app
from shared.runtime.exit_codes import Exit
from tools.docs.markdown import code, page, table

_INTRODUCTION = """`make setup` puts `hyrecro` into `.venv/bin`. Each command says the same with `--help`.

"""
_COMMON = {
    "--config": "`--config FILE` takes settings from a file, or from a preset in `configs/`",
    "--set": "`--set SECTION.KEY=VALUE`, as often as you like, changes one setting",
    "--json": "`--json` prints one JSON object",
}
_MEANINGS = {
    Exit.FINE: "fine",
    Exit.FAILED: "failed; stderr says why",
    Exit.USAGE: "wrong usage or configuration",
    Exit.PARTIAL: "partial: something was lost, or a checked row is bad",
    Exit.INTERRUPTED: "stopped by Ctrl-C",
}


def commands_page() -> str:
    """The whole page: exit codes, options that many commands share, every command."""
    parts = [_INTRODUCTION, "## Exit codes\n\n"]
    parts.append(table(["code", "meaning"], ([str(code_.value), _MEANINGS[code_]] for code_ in Exit)))
    parts += ["\n## Common options\n\nMany commands take these:\n\n", *(f"- {text}.\n" for text in _COMMON.values())]
    root: Any = typer.main.get_command(app)
    parts += [_section(*leaf) for leaf in _leaves(root, typer.Context(root, info_name="hyrecro"))]
    return page("Commands", *parts)


def _leaves(group: Any, context: typer.Context) -> Iterator[tuple[Any, typer.Context]]:
    for name, command in group.commands.items():
        below = typer.Context(command, info_name=name, parent=context)
        if hasattr(command, "commands"):
            yield from _leaves(command, below)
        else:
            yield command, below


def _section(command: Any, context: typer.Context) -> str:
    records = [parameter.get_help_record(context) for parameter in command.get_params(context)]
    records = [record for record in records if record is not None and record[0] != "--help"]
    common = [name for name in _COMMON if any(record[0].split()[0] == name for record in records)]
    own = [(name, text) for name, text in records if name.split()[0] not in _COMMON]
    section = f"\n## {context.command_path}\n\n{(command.help or '').strip()}\n"
    if own:
        section += "\n" + table(["argument or option", "what it is"], ([code(name), text] for name, text in own))
    if common:
        section += f"\nAlso {', '.join(map(code, common))}.\n"
    return section
