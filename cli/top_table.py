"""What `hyrecro top` shows: a line a service, a line a channel, within 80 columns."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cli.top import ChannelRow, Hearer, ServiceRow

_STATE_STYLES = {"ready": "green", "starting": "yellow", "silent": "bold red", "gone": "red"}
_SLOW_S = 0.1
"""A message that waited for so long is shown as a warning: a LiDAR's period."""


def tables(title: str, services: list[ServiceRow], channels: list[ChannelRow]) -> RenderableType:
    """Title, services, channels."""
    return Group(Text(title, no_wrap=True), Text(), _services(services), Text(), _channels(channels))


def _services(rows: list[ServiceRow]) -> Table:
    table = _table("service", "state")
    for heading in ("up", "CPU %", "busy", "MB", "in/s", "out/s", "wait ms", "drop", "lost", "ref"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(
            row.name,
            _state(row),
            _duration(row.uptime_s),
            _percent(row.cpu_ratio),
            _percent(row.busy_ratio),
            "-" if row.rss_bytes is None else f"{row.rss_bytes / 1e6:.0f}",
            _rate(row.received_hz),
            _rate(row.sent_hz),
            _wait(row.wait_max_s),
            *(_bad(count) for count in (row.num_dropped, row.num_missed, row.num_refused)),
        )
    return table


def _channels(rows: list[ChannelRow]) -> Table:
    table = _table("channel")
    table.add_column("/s", justify="right", no_wrap=True)
    table.add_column("kB/s", justify="right", no_wrap=True)
    table.add_column("from", no_wrap=True)
    table.add_column("to: wait in ms, drop, lost", ratio=1)
    for row in rows:
        table.add_row(
            row.key,
            _rate(row.rate_hz),
            "-" if row.bytes_per_s is None else f"{row.bytes_per_s / 1e3:.0f}",
            ", ".join(row.publishers) if len(row.publishers) < 3 else f"{len(row.publishers)} services",
            Text(", ").join(map(_hearer, row.hearers)),
        )
    return table


def _table(*headings: str) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, header_style="bold", expand=True)
    for heading in headings:
        table.add_column(heading, no_wrap=True)
    return table


def _state(row: ServiceRow) -> Text:
    is_late = row.state == "silent" and row.age_s is not None
    text = f"{row.state} {_duration(row.age_s)}" if is_late else row.state
    text += f" x{row.num_restarts + 1}" if row.num_restarts else ""
    return Text(text, style=_STATE_STYLES[row.state])


def _hearer(hearer: Hearer) -> Text:
    text = Text(hearer.service)
    if hearer.wait_max_s is not None:
        text.append_text(Text(" ").append_text(_wait(hearer.wait_max_s)))
    for count, name in ((hearer.num_dropped, "drop"), (hearer.num_missed, "lost")):
        if count:
            text.append(f" {count} {name}", style="yellow")
    return text


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return "-"
    if seconds < 100:
        return f"{seconds:.0f}s"
    minutes = int(seconds // 60)
    return f"{minutes}m" if minutes < 100 else f"{minutes // 60}h{minutes % 60:02d}"


def _percent(ratio: float | None) -> str:
    return "-" if ratio is None else f"{100 * ratio:.0f}"


def _rate(rate_hz: float | None) -> str:
    if rate_hz is None:
        return "-"
    return f"{rate_hz:.0f}" if rate_hz >= 99.5 else f"{rate_hz:.1f}"


def _wait(wait_s: float | None) -> Text:
    if wait_s is None:
        return Text("-")
    number = f"{1e3 * wait_s:.0f}" if wait_s >= 0.01 else f"{1e3 * wait_s:.1f}"
    return Text(number, style="yellow" if wait_s > _SLOW_S else "")


def _bad(count: int) -> Text:
    return Text(str(count), style="yellow" if count else "dim")
