"""What arrived of a climb over two hosts, what is counted missing and whether that balances, and how a cut healed."""

from __future__ import annotations

import itertools
import statistics
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench.faults_scoring import score_of
from bench.hosts.listener import KEYS_OF_BASE, Heard, read_heard
from services.recorder.bag.balance import balance_of, run_files
from services.recorder.bag.recorded import RecordingReader
from shared.messaging.channels import CHANNELS, channel_of_key
from shared.messaging.messages import Health

FLOWS = ("joints/state", "leg/state", "tf", "lidar/points", "depth/image", "map/odometry")
KEPT = ("leg/state", "map/cloud", "map/planes", "robot_description", "structure_description", "tf_static")
_MIN_STEP = 1e-6
"""Radians or metres from a joint state to the next: less is standing."""
_OWN = ("/recorder/status", "/health/recorder", "/events")
"""Topics of the recorder itself, which goes on after its last file, and one that many number."""


@dataclass(frozen=True, slots=True)
class Cut:
    """Monotonic time."""

    began_ns: int
    ended_ns: int


@dataclass(frozen=True, slots=True)
class Flow:
    """Of one key while the climb lasts. late: from its arrival at the robot's listener to that at the base's."""

    robot_hz: float
    base_hz: float
    late_p50_ms: float | None
    late_max_ms: float | None


def scored(folder: Path, began_ns: int, ended_ns: int, cut: Cut | None) -> dict[str, Any]:
    """Figures of a case, for JSON. folder: what `Line` left."""
    robot, base = read_heard(folder / "robot.jsonl"), read_heard(folder / "base.jsonl")
    on_robot, on_base = ([heard for heard in each if began_ns <= heard.at_ns <= ended_ns] for each in (robot, base))
    seconds = (ended_ns - began_ns) * 1e-9
    score = score_of(folder / "run")
    return {
        "flows": {key: asdict(_flow(key, on_robot, on_base, seconds)) for key in FLOWS},
        "num_recorded": score.num_messages,
        "num_missing": score.num_missing,
        "missing": score.missing,
        "unbalanced": unbalanced(folder / "run", [*robot, *base]),
        "ate_rmse_m": score.ate_rmse_m,
        "num_poses": score.num_poses,
        "num_untracked": score.num_untracked,
        "after_cut": _after_cut(cut, robot, base) if cut else None,
    }


def unbalanced(run: Path, heard: list[Heard]) -> dict[str, tuple[int, int]]:
    """Topics whose messages in the files and counted missing ones are not as many as were sent.

    Sent is from what the recorder first heard of, by a message or a heartbeat, to the last that either host heard.
    """
    topics = {channel.key: channel.topic for channel in CHANNELS}
    last: dict[str, int] = {}
    for each in heard:
        topic = topics.get(each.key, "/" + each.key)
        last[topic] = max(each.seq, last.get(topic, -1))
    first = _first_known(run)
    published = {topic.topic: topic.num_published for topic in balance_of(run).topics}
    counts = {
        topic: (num, last[topic] - first[topic] + 1)
        for topic, num in published.items()
        if num is not None and topic in last and topic not in _OWN
    }
    return {topic: pair for topic, pair in counts.items() if pair[0] != pair[1]}


def _first_known(run: Path) -> dict[str, int]:
    """By topic, the lowest number in the files, or the next after the one that a heartbeat first told of."""
    told: dict[str, int] = {}
    first: dict[str, int] = {}
    for path in run_files(run):
        for recorded in RecordingReader(path).messages():
            topic, seq = recorded.channel.topic, recorded.seq
            first[topic] = min(seq, first.get(topic, seq))
            message = recorded.message() if recorded.channel.message is Health else None
            for count in message.channels if isinstance(message, Health) else ():
                if (channel := channel_of_key(count.key)) is not None and count.num_sent and count.last_seq is not None:
                    told.setdefault(channel.topic, count.last_seq)
    return {topic: min(seq, told.get(topic, seq) + 1) for topic, seq in first.items()}


def _flow(key: str, robot: list[Heard], base: list[Heard], seconds: float) -> Flow:
    sent = {heard.seq: heard.at_ns for heard in robot if heard.key == key and not heard.is_asked}
    came = [heard for heard in base if heard.key == key and not heard.is_asked]
    late_ms = [(heard.at_ns - sent[heard.seq]) * 1e-6 for heard in came if heard.seq in sent]
    return Flow(
        robot_hz=round(len(sent) / seconds, 2),
        base_hz=round(len(came) / seconds, 2),
        late_p50_ms=round(statistics.median(late_ms), 1) if late_ms else None,
        late_max_ms=round(max(late_ms), 1) if late_ms else None,
    )


def _after_cut(cut: Cut, robot: list[Heard], base: list[Heard]) -> dict[str, Any]:
    """Seconds after the link was back: when each flow and what is kept came again, when the robot went on."""
    said_ns = {(heard.key, heard.seq): heard.at_ns for heard in robot if not heard.is_asked}
    flows: dict[str, float] = {}
    kept: dict[str, float] = {}
    for heard in sorted(base, key=lambda each: each.at_ns):
        if heard.at_ns < cut.ended_ns:
            continue
        after_s = round((heard.at_ns - cut.ended_ns) * 1e-9, 2)
        if heard.key in FLOWS and said_ns.get((heard.key, heard.seq), 0) > cut.ended_ns:
            flows.setdefault(heard.key, after_s)
        if heard.key in KEPT and heard.key not in KEYS_OF_BASE and heard.is_asked:
            kept.setdefault(heard.key, after_s)
    return {"flows_s": flows, "kept_s": kept, **_standstill(cut, robot)}


def _standstill(cut: Cut, robot: list[Heard]) -> dict[str, float | None]:
    states = [heard for heard in robot if heard.key == "joints/state" and not heard.is_asked]
    pairs = itertools.pairwise(states)
    moves_ns = [
        now.at_ns for was, now in pairs if max(abs(a - b) for a, b in zip(was.q, now.q, strict=True)) > _MIN_STEP
    ]
    halts_ns = [at_ns for at_ns in moves_ns if cut.began_ns < at_ns < cut.ended_ns]
    goes_on_ns = [at_ns for at_ns in moves_ns if at_ns >= cut.ended_ns]
    return {
        "stood_after_s": round((max(halts_ns, default=cut.began_ns) - cut.began_ns) * 1e-9, 2),
        "went_on_s": round((min(goes_on_ns) - cut.ended_ns) * 1e-9, 2) if goes_on_ns else None,
    }


def table(cases: list[dict[str, Any]]) -> str:
    """Markdown."""
    return "\n".join([*_flow_table(cases), "", *_run_table(cases)])


def _flow_table(cases: list[dict[str, Any]]) -> list[str]:
    lines = ["| link | Mbit/s | " + " | ".join(FLOWS) + " |", "|---|---|" + "---|" * len(FLOWS)]
    for each in cases:
        cells = (_cell(each["flows"][key]) for key in FLOWS)
        lines.append(f"| {_link(each)} | {each['mbit_per_s']} | " + " | ".join(cells) + " |")
    return lines


def _run_table(cases: list[dict[str, Any]]) -> list[str]:
    lines = [
        "| link | climb | recorded | missing | topics that do not balance | ATE RMSE |",
        "|---|---|---|---|---|---|",
    ]
    for each in cases:
        climb = f"{each['climb_s']} s" if each["exit_code"] == 0 else f"ended with {each['exit_code']}"
        ate = f"{1e3 * each['ate_rmse_m']:.2f} mm of {each['num_poses']} poses"
        counts = f"{each['num_recorded']} | {each['num_missing']} | {len(each['unbalanced'])}"
        lines.append(f"| {_link(each)} | {climb} | {counts} | {ate} |")
    return lines


def _link(each: dict[str, Any]) -> str:
    cut = f", cut {each['cut_s']:g} s" if each["cut_s"] else ""
    choice = "" if each["channels"] == ["*"] else ", recorder.channels without the large ones"
    return f"{1e3 * each['delay_s']:g} ms, {each['loss']:.0%}{cut}{choice}"


def _cell(flow: dict[str, Any]) -> str:
    if flow["late_p50_ms"] is None:
        return f"0 of {flow['robot_hz']:g} Hz"
    return f"{flow['base_hz']:g} of {flow['robot_hz']:g} Hz; {flow['late_p50_ms']:g}, {flow['late_max_ms']:g} ms"
