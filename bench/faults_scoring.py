"""What is left of a run whose processes were killed: its trajectory against the truth, its counts against numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from services.evaluator.trajectory_error import TrajectoryComparison
from services.recorder.bag.balance import RunBalance, balance_of, run_files
from services.recorder.bag.recorded import Recorded, RecordingReader
from shared.geometry import SE3
from shared.messaging.channels import EVENTS, MAP_ODOMETRY, MAP_STATUS, TF, Channel
from shared.messaging.frames import FrameTree
from shared.messaging.messages import Event, MapStatus, Odometry, Transforms

CONTINUED = ("/joints/state", "/actuators/state", "/tf", "/clock", "/leg/state", "/map/odometry", "/map/status")
"""What goes on in its numbers over a death: all that was ever said is numbered from 0 to the last."""


@dataclass(frozen=True, slots=True)
class RunScore:
    """ate_rmse_m: over all poses of the run's files, with the first laid on the truth.

    num_untracked: scans the mapper did not find in its map. unbalanced: topics of `CONTINUED` whose messages in the
    files and missing ones are not as many as their numbers. restored: what services said when they went on.
    """

    ate_rmse_m: float
    ate_max_m: float
    num_poses: int
    num_untracked: int
    num_files: int
    num_messages: int
    num_missing: int
    missing: dict[str, int]
    unbalanced: dict[str, tuple[int, int]]
    restored: dict[str, int]


def score_of(folder: Path) -> RunScore:
    """Of all files of a run."""
    balance = balance_of(folder)
    estimated = {
        message.stamp_ns: SE3.from_xyz_quat_xyzw(message.T_frame_child)
        for recorded in _recorded(folder, MAP_ODOMETRY)
        if isinstance(message := recorded.message(), Odometry)
    }
    error = _comparison(folder, estimated).result()
    statuses = (recorded.message() for recorded in _recorded(folder, MAP_STATUS))
    return RunScore(
        ate_rmse_m=error.ate_rmse_m,
        ate_max_m=error.ate_max_m,
        num_poses=error.num_poses,
        num_untracked=sum(isinstance(status, MapStatus) and not status.is_tracking for status in statuses),
        num_files=len(balance.files),
        num_messages=sum(topic.num_messages for topic in balance.topics),
        num_missing=balance.num_missing,
        missing={topic.topic: topic.num_missing for topic in balance.topics if topic.num_missing},
        unbalanced=_unbalanced(folder, balance),
        restored=_restored(folder),
    )


def _comparison(folder: Path, estimated: dict[int, SE3]) -> TrajectoryComparison:
    comparison, seen = TrajectoryComparison(), set()
    for recorded in _recorded(folder, TF):
        if recorded.stamp_ns in estimated and recorded.stamp_ns not in seen:
            seen.add(recorded.stamp_ns)
            transforms = recorded.message()
            assert isinstance(transforms, Transforms)
            comparison.add(estimated[recorded.stamp_ns], FrameTree(transforms).T_root("lidar"))
    return comparison


def _unbalanced(folder: Path, balance: RunBalance) -> dict[str, tuple[int, int]]:
    last_seq: dict[str, int] = {}
    for path in run_files(folder):
        for recorded in RecordingReader(path, lambda channel: channel.topic in CONTINUED).messages():
            last_seq[recorded.channel.topic] = max(recorded.seq, last_seq.get(recorded.channel.topic, -1))
    published = {topic.topic: topic.num_published or 0 for topic in balance.topics}
    numbered = {topic: (published[topic], seq + 1) for topic, seq in last_seq.items()}
    return {topic: counts for topic, counts in numbered.items() if counts[0] != counts[1]}


def _restored(folder: Path) -> dict[str, int]:
    num: dict[str, int] = {}
    for recorded in _recorded(folder, EVENTS):
        event = recorded.message()
        if isinstance(event, Event) and event.text.startswith("restored"):
            num[event.source] = num.get(event.source, 0) + 1
    return num


def _recorded(folder: Path, channel: Channel) -> Iterator[Recorded]:
    for path in run_files(folder):
        yield from RecordingReader(path, lambda each: each.topic == channel.topic).messages()
