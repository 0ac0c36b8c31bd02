"""Markdown that is made from code."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

_NOTE = "<!-- Made by `python -m tools.docs`: change the code it is made from. -->"


def page(title: str, *parts: str) -> str:
    """A whole page, with a note for who would edit it."""
    return "".join((f"# {title}\n\n{_NOTE}\n\n", *parts))


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; cells are escaped and stay on one line."""
    lines = [_line(heads), "|" + "---|" * len(heads), *map(_line, rows)]
    return "\n".join(lines) + "\n"


def code(text: str) -> str:
    """Text as inline code; empty text stays empty. A bar in it would end a table's cell."""
    if "|" in text:
        return f"<code>{escape(text, quote=False).replace('|', '&#124;')}</code>"
    return f"`{text}`" if text else ""


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"
