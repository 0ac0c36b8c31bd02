"""What `hyrecro bag` finds, as tables for people and as JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from services.recorder.bag.overview import Overview
from services.recorder.bag.recovery import Recovered
from services.recorder.bag.verification import TopicReport, Verification

_WIDTH = 120


def info_json(overview: Overview) -> dict[str, Any]:
    """What `bag info --json` prints."""
    return {
        "path": str(overview.path),
        "state": overview.state,
        "problems": list(overview.problems),
        "has_index": overview.has_index,
        "bytes": overview.num_bytes,
        "chunks": overview.num_chunks,
        "messages": overview.num_messages,
        "start_ns": overview.first_ns,
        "duration_s": overview.duration_s,
        "version": overview.run.get("version"),
        "seed": overview.run.get("seed"),
        "topics": [
            {
                "topic": topic.topic,
                "type": topic.ros_type,
                "messages": topic.num_messages,
                "rate_hz": _rate_hz(topic.num_messages, overview.duration_s),
                "published": topic.counts.num_published,
                "received": topic.counts.num_received,
                "written": topic.counts.num_written,
                "lost_on_bus": topic.counts.num_lost_on_bus,
                "lost_to_disk": topic.counts.num_lost_to_disk,
            }
            for topic in overview.topics
        ],
    }


def print_info(overview: Overview) -> None:
    """A head and a table of topics."""
    print(f"{overview.path}: {overview.state}")
    for problem in overview.problems:
        print(f"  {problem}")
    if not overview.has_index:
        print("  no index at its end: read from its whole chunks; `hyrecro bag recover` makes a whole file of them")
    print(f"duration  {overview.duration_s:.2f} s from {overview.first_ns / 1e9:.2f} s on")
    print(
        f"size      {overview.num_bytes / 1e6:.1f} MB, {overview.num_chunks} chunks, {overview.num_messages} messages"
    )
    print(f"made by   version {overview.run.get('version', 'unknown')}, seed {overview.run.get('seed', 'unknown')}")
    table = _table("topic", "type", "messages", "Hz", "published", "received", "written", "lost")
    for topic in overview.topics:
        counts = topic.counts
        table.add_row(
            topic.topic,
            topic.ros_type.replace("/msg/", "/"),
            str(topic.num_messages),
            f"{_rate_hz(topic.num_messages, overview.duration_s):.1f}",
            *(_known(number) for number in (counts.num_published, counts.num_received, counts.num_written)),
            str(counts.num_lost),
        )
    _print(table)


def verification_json(verification: Verification) -> dict[str, Any]:
    """What `bag verify --json` prints."""
    return {
        "is_fine": verification.is_fine,
        "problems": verification.problems,
        "topics": [asdict(report) | {"is_fine": report.is_fine} for report in verification.topics.values()],
    }


def print_verification(verification: Verification) -> None:
    """A table of topics, the problems, and a verdict."""
    table = _table("topic", "messages", "missing", "restarts", "backward", "unreadable", "lost", "")
    for report in verification.topics.values():
        table.add_row(
            report.topic,
            str(report.num_messages),
            str(report.num_gaps),
            str(report.num_restarts),
            str(report.num_backward),
            str(report.num_unreadable),
            str(report.num_lost),
            _verdict(report),
        )
    _print(table)
    for problem in [*verification.problems, *(line for of in verification.topics.values() for line in of.problems)]:
        print(problem)
    num_messages = sum(report.num_messages for report in verification.topics.values())
    print(f"{num_messages} messages: {'all fine' if verification.is_fine else 'not all is there'}")


def recovered_json(recovered: Recovered) -> dict[str, Any]:
    """What `bag recover --json` prints."""
    return {
        "messages": sum(recovered.num_messages.values()),
        "chunks": recovered.num_chunks,
        "duration_s": (recovered.last_ns - recovered.first_ns) / 1e9,
        "topics": recovered.num_messages,
        "lost": recovered.num_lost,
        "lost_nameless": recovered.num_nameless,
        "lost_bytes": recovered.num_lost_bytes,
        "damage": [asdict(damage) for damage in recovered.damage],
    }


def print_recovered(recovered: Recovered, out: Path) -> None:
    """What came back, and what did not."""
    num, duration_s = sum(recovered.num_messages.values()), (recovered.last_ns - recovered.first_ns) / 1e9
    print(f"{out}: {num} messages of {duration_s:.2f} s from {recovered.num_chunks} whole chunks")
    for damage in recovered.damage:
        print(f"  {damage}")
    for topic, num_lost in recovered.num_lost.items():
        print(f"  {topic}: {num_lost} messages lost")
    if recovered.num_nameless:
        print(f"  {recovered.num_nameless} messages whose channels are not known any more")
    if not recovered.has_losses:
        print("  nothing was lost")


def _verdict(report: TopicReport) -> str:
    if report.is_fine:
        return "fine"
    if report.num_expected is not None and report.num_expected != report.num_messages:
        return f"{report.num_expected} by the index"
    return "not all is there"


def _rate_hz(num_messages: int, duration_s: float) -> float:
    return num_messages / duration_s if duration_s > 0 else 0.0


def _known(number: int | None) -> str:
    return "-" if number is None else str(number)


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in columns:
        is_text = column in ("topic", "type", "")
        table.add_column(column, justify="left" if is_text else "right", no_wrap=True)
    return table


def _print(table: Table) -> None:
    console = Console()
    Console(width=max(console.width, _WIDTH)).print(table)
