"""The list of decisions, from their files."""

from __future__ import annotations

from pathlib import Path

from tools.docs.markdown import page, table


def decisions_page(folder: Path) -> str:
    """A line for each file of `folder`: its number and title."""
    titles = {path.name: path.read_text(encoding="utf-8").splitlines()[0] for path in sorted(folder.glob("[0-9]*.md"))}
    rows = ([number, f"[{title}]({name})"] for name, head in titles.items() for number, title in [_parts(head)])
    text = "What someone will question, each in half a page: what was decided, why, and its price.\n\n"
    return page("Decisions", text, table(["", "decision"], rows))


def _parts(head: str) -> tuple[str, str]:
    number, _, title = head.removeprefix("# ").partition(". ")
    return number, title
