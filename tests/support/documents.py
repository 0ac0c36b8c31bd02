"""The programs and commands that the documentation tells people to run."""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def programs(page: str) -> list[str]:
    """Each block of Python on a page of `docs/`."""
    return _blocks(page, "python")


def commands(page: str, name: str) -> list[str]:
    """Each command line on a page of `docs/` that begins with this name."""
    lines = [line for block in _blocks(page, "sh") for line in block.splitlines()]
    return [line for line in lines if line.startswith(f"{name} ")]


def _blocks(page: str, language: str) -> list[str]:
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
