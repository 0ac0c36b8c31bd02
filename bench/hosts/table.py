"""`python -m bench.hosts.table hosts.json` prints what `bench.hosts` measured as Markdown."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

KEYS = ("joints/state", "lidar/points", "leg/state", "map/odometry")
HEAD = (
    "| loss | delay | Mbit/s | "
    + " | ".join(KEYS)
    + " | odometry on the robot | a command's answer: median, slowest | unanswered |"
)


def table(results: dict[str, dict[str, Any]]) -> str:
    """A line a case: of each key what came of what was published, and its share."""
    lines = [HEAD, "|" + "---|" * (HEAD.count("|") - 1)]
    for case in results.values():
        kept = " | ".join(_arrived(case["counts"][key]) for key in KEYS)
        seconds = case["seconds"]
        hz = case["robot"]["num_received"].get("map/odometry", 0) / seconds
        gap_s = case["robot"]["longest_gap_s"]["map/odometry"]
        cut = f", cut {case['cut_s']:g} s" if case["cut_s"] else ""
        lines.append(
            f"| {case['loss']:.0%} | {case['delay_ms']:g} ms{cut} | {case['mbit_per_s']} | {kept} | "
            f"{hz:.1f} Hz, longest gap {gap_s:.2f} s | {case['answer_ms']}, {case['slowest_answer_ms']} ms | "
            f"{case['base']['num_unanswered']} of {case['num_answers'] + case['base']['num_unanswered']} |"
        )
    return "\n".join(lines)


def _arrived(count: dict[str, int]) -> str:
    """Every message is received or counted lost: the two make up what was published."""
    published, received = count["num_published"], count["num_received"]
    return f"{received} of {published} ({received / max(published, 1):.0%})"


if __name__ == "__main__":
    print(table(json.loads(Path(sys.argv[1]).read_text())))
