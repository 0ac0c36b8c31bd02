"""What the files of one run hold together, as tables for people and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from cli.bag_tables import verification_json
from services.recorder.bag.balance import RunBalance
from services.recorder.bag.verification import Verification

_WIDTH = 120


def balance_json(balance: RunBalance) -> dict[str, Any]:
    """What `bag info FOLDER --json` prints."""
    return {
        "path": str(balance.folder),
        "state": balance.state,
        "files": [
            {
                "path": str(file.path),
                "state": file.state,
                "problems": list(file.problems),
                "messages": file.num_messages,
                "start_ns": file.first_ns,
                "duration_s": file.duration_s,
            }
            for file in balance.files
        ],
        "missing": balance.num_missing,
        "topics": [
            {
                "topic": topic.topic,
                "published": topic.num_published,
                "messages": topic.num_messages,
                "repeated": topic.num_repeated,
                "missing": topic.num_missing,
            }
            for topic in balance.topics
        ],
    }


def print_balance(balance: RunBalance) -> None:
    """A table of files and a table of topics."""
    print(f"{balance.folder}: {balance.state}")
    files = _table("file", "state", "from s", "to s", "messages")
    for file in balance.files:
        times = f"{file.first_ns / 1e9:.2f}", f"{file.last_ns / 1e9:.2f}"
        files.add_row(file.path.name, file.state, *times, str(file.num_messages))
    topics = _table("topic", "published", "in the files", "missing", "repeated")
    for topic in balance.topics:
        published, missing = ("-" if num is None else str(num) for num in (topic.num_published, topic.num_missing))
        topics.add_row(topic.topic, published, str(topic.num_messages), missing, str(topic.num_repeated))
    console = Console()
    wide = Console(width=max(console.width, _WIDTH))
    wide.print(files)
    wide.print(topics)
    print(f"{balance.num_missing} messages are in none of the files; commands have no numbers and are not counted")


def folder_verification_json(balance: RunBalance, verifications: Sequence[Verification]) -> dict[str, Any]:
    """What `bag verify FOLDER --json` prints."""
    files = [{"path": str(each.overview.path), **verification_json(each)} for each in verifications]
    return {**balance_json(balance), "files": files}


def print_folder_verification(balance: RunBalance, verifications: Sequence[Verification]) -> None:
    """The tables of the whole run, and what is wrong with each file."""
    print_balance(balance)
    for each in verifications:
        lines = [*each.problems, *(line for topic in each.topics.values() for line in topic.problems)]
        num_unreadable = sum(topic.num_unreadable for topic in each.topics.values())
        verdict = "fine" if each.is_fine else f"not all is there, {num_unreadable} messages are not readable"
        print(f"{each.overview.path.name}: {verdict}")
        for line in lines:
            print(f"  {line}")


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        table.add_column(column, justify="left" if column in ("file", "state", "topic") else "right", no_wrap=True)
    return table
