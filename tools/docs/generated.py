"""Every text that is made from code, by the file it stands in."""

from __future__ import annotations

from pathlib import Path

from cli.announcer import NAME as SUPERVISOR
from tools.docs.access import router_file
from tools.docs.commands import commands_page
from tools.docs.dataflow import dataflow_svg
from tools.docs.decisions import decisions_page
from tools.docs.keys import channel_table, ros_table
from tools.docs.messages import messages_page
from tools.docs.settings import settings_page
from tools.docs.wiring import all_wires

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
_BEGIN, _END = "<!-- channels: generated -->\n", "<!-- /channels -->\n"


def generated_files() -> dict[Path, str]:
    """What each of them should hold now."""
    return {
        DOCS / "reference" / "messages.md": messages_page(),
        DOCS / "reference" / "commands.md": commands_page(),
        DOCS / "reference" / "settings.md": settings_page(),
        DOCS / "adr" / "README.md": decisions_page(DOCS / "adr"),
        DOCS / "pictures" / "dataflow.svg": dataflow_svg([wired for wired in all_wires() if wired.name != SUPERVISOR]),
        ROOT / "configs" / "zenoh" / "secure" / "router.json5": router_file(all_wires()),
        ROOT / "ARCHITECTURE.md": _with_table(ROOT / "ARCHITECTURE.md", channel_table()),
        DOCS / "ros.md": _with_table(DOCS / "ros.md", ros_table()),
    }


def _with_table(path: Path, table: str) -> str:
    """The document with the table between its two marks."""
    head, rest = path.read_text(encoding="utf-8").split(_BEGIN)
    return head + _BEGIN + table + _END + rest.split(_END)[1]
