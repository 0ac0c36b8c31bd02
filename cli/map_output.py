"""Writes and prints what `hyrecro map` found."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cli.mapping import MapRun
from shared.cloud_files import write_cloud
from shared.messaging.messages import Severity
from shared.trajectory_files import write_tum


def write_results(run: MapRun, map_path: Path | None, trajectory_path: Path | None) -> None:
    """The map as a cloud by its suffix, the trajectory in the TUM format."""
    if map_path is not None:
        write_cloud(map_path, run.map_points_m)
    if trajectory_path is not None:
        write_tum(trajectory_path, zip(run.stamps_ns, run.poses, strict=True))


def print_summary(run: MapRun, figures: dict[str, Any]) -> None:
    """A table on stdout; what people should know on stderr. A map's error needs the truth: see `hyrecro eval`."""
    for event in run.events:
        if event.severity is not Severity.INFO:
            print(f"{event.stamp_ns / 1e9:.1f} s: {event.text}", file=sys.stderr)
    table = Table(show_header=False, title=f"{figures['scans']} scans by {figures['method']}")
    for name, text in _rows(figures):
        table.add_row(name, text)
    Console().print(table)


def _rows(figures: dict[str, Any]) -> list[tuple[str, str]]:
    refine_ms = figures["refine_ms"] / max(figures["scans"], 1)
    refined = f", and {refine_ms:.1f} ms to refine" if refine_ms else ""
    numbers = figures["lost_scan_numbers"]
    named = f" ({', '.join(map(str, numbers[:10]))}{', ...' if len(numbers) > 10 else ''})" if numbers else ""
    return [
        ("time a scan, median", f"{figures['ms_per_scan_p50']:.1f} ms{refined}"),
        ("time a scan, 99 %", f"{figures['ms_per_scan_p99']:.1f} ms"),
        ("map", f"{figures['map_points']} points, {figures['planes']} planes"),
        ("scans lost", f"{figures['lost_scans']}{named}"),
        ("scans held by the prior", str(figures["degenerate_scans"])),
        ("memory, highest", f"{figures['peak_rss_mb']:.0f} MB"),
    ]
