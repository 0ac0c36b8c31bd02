"""Hears what is said on one host: `python -m bench.hosts.listener ENDPOINT FILE PATTERN ...`.

A line on stdin is answered by a line of JSON: which services are ready, and how many messages of the robot came so far.
When stdin ends, a line for each message stands in the file.
"""

from __future__ import annotations

import json
import select
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from services.recorder.selection import Selection
from shared.messaging.bus import Bus
from shared.messaging.channels import CHANNELS, channel_of_key
from shared.messaging.codec import decode
from shared.messaging.inbox import Inbox, Parcel
from shared.messaging.messages import JointState, Measurement
from shared.runtime.config import BusConfig
from shared.runtime.health import source_of

KEYS_OF_BASE = frozenset({"tf_static", "eval/metrics", "recorder/status", "health/recorder", "health/evaluator"})
"""What recorder and evaluator say; all else comes from the robot."""
_MAX_BYTES = 256 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class Heard:
    """key: below `hyrecro/`. source: who numbers an event. at_ns: monotonic time, which both hosts share here.

    is_asked: an answer to our question for the last message. q: of a joint state, else empty.
    """

    key: str
    source: str
    seq: int
    at_ns: int
    is_asked: bool
    q: tuple[float, ...]


def read_heard(path: Path) -> list[Heard]:
    """What a listener wrote."""
    return [Heard(**json.loads(line)) for line in path.read_text().splitlines()]


def _heard(parcel: Parcel) -> Heard | None:
    channel = channel_of_key(parcel.key)
    message = decode(parcel.channel.message, parcel.payload)
    if channel is None or not isinstance(message, Measurement):
        return None
    q = tuple(message.q.tolist()) if isinstance(message, JointState) else ()
    return Heard(channel.key, source_of(message), message.seq, parcel.received_ns, parcel.is_replay, q)


def listen(bus: Bus, out: Path, wanted: Selection) -> None:
    """Until stdin ends."""
    inbox, num_of_robot = Inbox(max_bytes=_MAX_BYTES), 0
    for channel in CHANNELS:
        if channel in wanted and not channel.is_command:
            bus.subscribe(channel, inbox)
    print("ready", flush=True)
    with out.open("w") as file:
        while True:
            if select.select([sys.stdin], [], [], 0.0)[0]:
                if not sys.stdin.readline():
                    return
                print(json.dumps({"alive": sorted(bus.alive()), "num_of_robot": num_of_robot}), flush=True)
            parcel = inbox.take(0.05)
            if parcel is not None and (heard := _heard(parcel)) is not None:
                num_of_robot += heard.key not in KEYS_OF_BASE
                file.write(json.dumps(asdict(heard)) + "\n")


def main() -> None:
    """Listens."""
    endpoint, out, *patterns = sys.argv[1:]
    with Bus(BusConfig(endpoint=endpoint, shared_memory_mib=0)) as bus:
        listen(bus, Path(out), Selection(tuple(patterns)))


if __name__ == "__main__":
    main()
