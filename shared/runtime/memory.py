"""Keeps what a node wants to remember, at the right moments, and gives it back at the start."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from shared.errors import HyrecroError, SnapshotError
from shared.messaging.messages import Event, Message, Severity
from shared.runtime.node import Addressed, Memory, Node
from shared.runtime.snapshots import Snapshots

_LEAST_PERIOD = 50
"""A part that is not kept at once is kept at most so often that it takes a fiftieth of the time."""


def keeper_of(node: Node, folder: Path | None, settings: str) -> Keeper | None:
    """Of a node that wants to remember something, where there is a folder for it."""
    if node.memory is None or folder is None:
        return None
    return Keeper(node.memory, Snapshots(folder, node.name, settings), node.name)


class Keeper:
    """Writes the parts of a memory: those without a period before anything is said, others after it when it is time."""

    def __init__(self, memory: Memory, snapshots: Snapshots, service: str) -> None:
        self._memory, self._snapshots, self._service = memory, snapshots, service
        self._urgent = {name: part for name, part in memory.parts.items() if part.period_s == 0}
        self._others = {name: part for name, part in memory.parts.items() if part.period_s > 0}
        self._due_s = dict.fromkeys(self._others, 0.0)  # at once, when there is something to keep
        self._is_failing = False

    def recall(self) -> list[Message | Addressed]:
        """Gives the node back what it knew; returns what it says then, or what to say where that cannot be had."""
        try:
            states = {name: self._snapshots.read(name, part.kind) for name, part in self._memory.parts.items()}
            if any(state is None for state in states.values()):
                return []
            return list(self._memory.restore(states))
        except (HyrecroError, ValueError) as error:
            return [_warning(self._service, f"begins afresh, its snapshot is not usable: {error}")]

    def before_said(self) -> list[Event]:
        """Keeps what nobody may hear of without its being kept; returns what to say of a failure, once."""
        states = {name: part.snapshot() for name, part in self._urgent.items()}
        return self._keep({name: state for name, state in states.items() if state is not None})

    def after_said(self) -> list[Event]:
        """Keeps what it is time for."""
        now_s = time.monotonic()
        said: list[Event] = []
        for name, part in self._others.items():
            if now_s >= self._due_s[name] and (state := part.snapshot()) is not None:
                said += self._keep({name: state})
                end_s = time.monotonic()
                self._due_s[name] = now_s + max(part.period_s, _LEAST_PERIOD * (end_s - now_s))
        return said

    def _keep(self, states: Mapping[str, Any]) -> list[Event]:
        try:
            for name, state in states.items():
                self._snapshots.write(name, state)
        except SnapshotError as error:
            was_failing, self._is_failing = self._is_failing, True
            return [] if was_failing else [_warning(self._service, f"its state is not kept: {error}")]
        self._is_failing = False
        return []


def _warning(service: str, text: str) -> Event:
    return Event(stamp_ns=0, seq=0, frame="", source=service, severity=Severity.WARNING, text=text)
