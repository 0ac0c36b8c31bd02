"""The results of a sweep as one table: CSV with every figure, Markdown and terminal with the main ones."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

from rich.table import Table

Result = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Column:
    """One of the main figures: its title, where it stands in the flat row, how it is shown."""

    title: str
    key: str
    show: Callable[[Any], str]


def _mm(value: float) -> str:
    return f"{value * 1000:.2f}"


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


_COLUMNS = (
    Column("scans", "scans", _plain),
    Column("method", "method", _plain),
    Column("voxel [m]", "voxel_m", _plain),
    Column("noise [m]", "range_noise_m", _plain),
    Column("seed", "seed", _plain),
    Column("ATE [mm]", "eval.ate_rmse_m", _mm),
    Column("RPE [mm]", "eval.rpe_rmse_m", _mm),
    Column("RPE [deg]", "eval.rpe_rot_rmse_deg", lambda value: f"{value:.3f}"),
    Column("drift [mm]", "eval.drift_m", _mm),
    Column("right steps", "right_steps", _plain),
    Column("lost", "map.lost_scans", _plain),
    Column("accuracy [mm]", "eval.map_accuracy_mean_m", _mm),
    Column("off planes", "map.off_plane_points", _plain),
    Column("complete 5 cm", "eval.completeness_5cm", lambda value: f"{value * 100:.1f} %"),
    Column("ms a scan", "map.ms_per_scan_p50", lambda value: f"{value:.1f}"),
)
_ERROR = Column("error", "error", _plain)


def rows_of(results: Sequence[Result]) -> list[dict[str, Any]]:
    """A flat row a case: what it was, then every figure of `map` and `eval` that is one value."""
    return [_row(result) for result in results]


def csv_text(rows: Sequence[dict[str, Any]]) -> str:
    """All figures, a column each; empty where a case has none."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    text = StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def markdown_text(rows: Sequence[dict[str, Any]]) -> str:
    """The main figures; a column that is empty throughout is left out."""
    columns = _filled(rows, (*_COLUMNS, _ERROR))
    lines = [[column.title for column in columns], ["---"] * len(columns)]
    lines += [[_text(column, row).replace("|", "\\|") for column in columns] for row in rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def terminal_table(rows: Sequence[dict[str, Any]]) -> Table:
    """The same for a terminal, without the texts of errors."""
    columns = _filled(rows, _COLUMNS)
    table = Table(*(column.title for column in columns))
    for row in rows:
        table.add_row(*(_text(column, row) for column in columns))
    return table


def _filled(rows: Sequence[dict[str, Any]], columns: Sequence[Column]) -> list[Column]:
    return [column for column in columns if any(row.get(column.key) is not None for row in rows)]


def _text(column: Column, row: dict[str, Any]) -> str:
    value = row.get(column.key)
    return "" if value is None else column.show(value)


def _row(result: Result) -> dict[str, Any]:
    case, scans = result["case"], result["case"]["scans"]
    row: dict[str, Any] = {
        "scans": Path(scans["trajectory"]).stem if scans["trajectory"] else Path(scans["folder"]).name,
        "method": case["method"],
        "voxel_m": case["voxel_m"],
        "range_noise_m": scans["range_noise_m"],
        "seed": case["seed"],
    }
    for name in ("map", "eval"):
        figures = result[name] or {}
        row |= {f"{name}.{key}": value for key, value in figures.items() if not isinstance(value, list | dict)}
    if (scored := result["eval"]) is not None:
        row["right_steps"] = f"{scored['pairs_ok']}/{scored['num_pairs']}"
    return row | {"error": result["error"]}
