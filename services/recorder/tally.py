"""The counts of a file and of a run, by key. They balance to the message:

published = received + lost on the bus; received = written + lost to disk + what waits for its chunk.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

from shared.messaging.channels import Channel

COMPLETE, INCOMPLETE = "COMPLETE", "INCOMPLETE"

RUN_METADATA = "hyrecro_run"
COUNTS_METADATA = "hyrecro_counts"
END_METADATA = "hyrecro_end"


@dataclass(slots=True)
class KeyTally:
    """Of one key. num_dropped: received, with no room in the queue. num_repeated: of an earlier file, at the head."""

    topic: str
    is_command: bool
    num_received: int = 0
    num_written: int = 0
    num_lost_on_bus: int = 0
    num_dropped: int = 0
    num_repeated: int = 0

    @property
    def num_published(self) -> int | None:
        """None: nobody numbers commands."""
        return None if self.is_command else self.num_received + self.num_lost_on_bus

    @property
    def num_lost_to_disk(self) -> int:
        """When nothing is going to be written any more."""
        return self.num_received - self.num_written

    def add(self, other: KeyTally) -> None:
        """Adds the counts of a later file."""
        self.num_received += other.num_received
        self.num_written += other.num_written
        self.num_lost_on_bus += other.num_lost_on_bus
        self.num_dropped += other.num_dropped
        self.num_repeated += other.num_repeated


class Tally:
    """By key."""

    def __init__(self) -> None:
        self.keys: dict[str, KeyTally] = {}

    def of(self, channel: Channel) -> KeyTally:
        """The counts of a channel, from zero."""
        tally = self.keys.get(channel.key)
        if tally is None:
            tally = self.keys[channel.key] = KeyTally(channel.topic, channel.is_command)
        return tally

    def add(self, other: Tally) -> None:
        """Adds the counts of a later file."""
        for key, tally in other.keys.items():
            self.keys.setdefault(key, KeyTally(tally.topic, tally.is_command)).add(tally)

    def set_written(self, num_written: Mapping[str, int]) -> None:
        """Notes what stands in whole chunks."""
        for key, tally in self.keys.items():
            tally.num_written = num_written.get(key, 0)

    @property
    def has_losses(self) -> bool:
        """On the bus or to disk, when nothing is going to be written any more."""
        return any(tally.num_lost_on_bus or tally.num_lost_to_disk for tally in self.keys.values())

    def metadata(self, reason: str) -> dict[str, dict[str, str]]:
        """What stands at the end of a file. reason: why it ended early, "" if it did not."""
        counts = {
            tally.topic: json.dumps(
                {
                    "num_published": tally.num_published,
                    "num_received": tally.num_received,
                    "num_written": tally.num_written,
                    "num_lost_on_bus": tally.num_lost_on_bus,
                    "num_lost_to_disk": tally.num_lost_to_disk,
                    "num_repeated": tally.num_repeated,
                }
            )
            for tally in self.keys.values()
        }
        state = INCOMPLETE if reason or self.has_losses else COMPLETE
        return {COUNTS_METADATA: counts, END_METADATA: {"state": state, "reason": reason}}
