"""The index at the end of an MCAP file, if it is there and whole."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from mcap.reader import SeekingReader
from mcap.records import Statistics
from mcap.summary import Summary

from shared.mcap_chunks import BROKEN, size_of

_MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True, slots=True)
class Index:
    """metadata: by name."""

    summary: Summary
    statistics: Statistics
    metadata: dict[str, dict[str, str]]


def index_of(path: Path) -> Index | None:
    """None where the file has none, or a damaged one, or does not exist."""
    try:
        with path.open("rb") as file:
            file.seek(-len(_MAGIC), os.SEEK_END)
            if file.read() != _MAGIC:
                return None
            file.seek(0)
            reader = SeekingReader(file, validate_crcs=True, record_size_limit=size_of(file))
            if (summary := reader.get_summary()) is None or summary.statistics is None:
                return None  # without an index the library would read all of the file
            metadata = {entry.name: dict(entry.metadata) for entry in reader.iter_metadata()}
    except (OSError, *BROKEN):
        return None
    return Index(summary, summary.statistics, metadata)
