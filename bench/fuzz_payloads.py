"""`python -m bench.fuzz_payloads`: fuzzed payloads over every key of every service and every entry of the codec.

In one process each goes the way that the runner takes: inbox, codec, facade, refusal, answer. A share goes over a real
bus into a real pipeline. What is counted must balance to the message; nothing may grow.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import json
import logging
import random
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import psutil
import structlog

from bench.fuzz_pipeline import over_the_bus
from fuzz.examples import MESSAGES
from fuzz.facades import SERVICES, build, said_by
from fuzz.mutations import payload_like
from shared.errors import CodecError
from shared.messaging.bus import Bus
from shared.messaging.channels import CHANNELS, HEALTH, Channel
from shared.messaging.codec import decode, decode_command, from_text, to_text
from shared.messaging.inbox import Inbox, Parcel
from shared.messaging.messages import Health, Message
from shared.messaging.router import open_router
from shared.runtime.config import BusConfig
from shared.runtime.node import Context
from shared.runtime.runner import ServiceLoop
from tests.support.examples import EXAMPLES
from tests.support.processes import free_endpoint

_OUT = Path("docs/benchmarks")
_SHARES = {
    "sim": 80,
    "recorder": 60,
    "replay": 40,
    "sim_dynamic": 10,
    "mapper": 10,
    "lidar": 5,
    "depth": 5,
    "planner": 2,
}
_SHARE = 20
"""Those that take commands get most; those whose answer takes long, such as a planned step, get less."""
_WARM_UP = 0.3
_MIB = 1024 * 1024


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of the payloads of one service or entry. rss_*: of this process after the warm-up and at the end."""

    name: str
    num_keys: int
    num_sent: int
    num_received: int
    num_refused: int
    seconds: float
    rss_warm_mib: float
    rss_end_mib: float

    @property
    def is_balanced(self) -> bool:
        """Whether each payload was either received or refused."""
        return self.num_sent == self.num_received + self.num_refused

    def with_more(self, other: Outcome) -> Outcome:
        """With the counts of another run; of memory that of the run which grew more."""
        grown = max(self, other, key=lambda of: of.rss_end_mib - of.rss_warm_mib)
        return replace(
            grown,
            num_keys=max(self.num_keys, other.num_keys),
            num_sent=self.num_sent + other.num_sent,
            num_received=self.num_received + other.num_received,
            num_refused=self.num_refused + other.num_refused,
            seconds=self.seconds + other.seconds,
        )


class Payloads:
    """Nearly messages of a channel, from examples and from what a simulation has said."""

    def __init__(self, rng: random.Random, good: list[tuple[Channel, Message]]) -> None:
        self._rng = rng
        self._examples: dict[type[Message], list[Message]] = defaultdict(list)
        for message in (*EXAMPLES, *(message for _, message in good)):
            if len(self._examples[type(message)]) < 6:
                self._examples[type(message)].append(message)

    def of(self, message_type: type[Message], *, is_command: bool) -> bytes:
        """Nearly a message of this type."""
        return payload_like(self._rng.choice(self._examples[message_type]), self._rng, is_command=is_command)


class Feeder:
    """Asked by the loop whether it shall stop, it puts the next payload into the inbox once the last is answered."""

    def __init__(self, parcels: Iterator[Parcel], inbox: Inbox, num_warm: int) -> None:
        self._parcels, self._inbox, self._num_warm = parcels, inbox, num_warm
        self.num_sent: Counter[str] = Counter()
        self._num_left = 0
        self.rss_warm_mib = 0.0

    def is_done(self) -> bool:
        """Whether all have been answered."""
        if self._num_left:
            return False
        self._num_warm -= 1
        if self._num_warm == 0:
            self.rss_warm_mib = _rss_mib()
        parcel = next(self._parcels, None)
        if parcel is not None:
            self.num_sent[parcel.key] += 1
            self._num_left += 1
            assert self._inbox.put(replace(parcel, reply=self._answered))
        return parcel is None

    def _answered(self, _is_accepted: bool, _reason: str) -> None:
        self._num_left -= 1


def through_the_runner(
    name: str, folder: Path, num: int, payloads: Payloads, good: list[tuple[Channel, Message]], rng: random.Random
) -> Outcome:
    """Feeds a service; what it knows first is what a simulation says."""
    context = Context(clock_ns=time.monotonic_ns)
    node = replace(build(name, folder, context), name=name, is_done=lambda: False, num_lost=dict)
    for channel, message in good:
        for known, handle in node.inputs.items():
            if known.key == channel.key:
                list(handle(message))
    channels = list(node.inputs)

    def parcels() -> Iterator[Parcel]:
        for _ in range(num):
            channel = rng.choice(channels)
            payload = payloads.of(channel.message, is_command=channel.is_command)
            key = channel.key_expr.replace("*", "someone")
            yield Parcel(channel, key, payload, None, time.monotonic_ns())

    endpoint = free_endpoint()
    config = BusConfig(endpoint=endpoint)
    with open_router(endpoint), Bus(config) as bus, Bus(config) as watcher:
        inbox = Inbox()
        feeder = Feeder(parcels(), inbox, int(_WARM_UP * num))
        started_s = time.monotonic()
        ServiceLoop(node, bus, context, inbox).run(feeder.is_done)
        seconds = time.monotonic() - started_s
        health = watcher.ask(HEALTH.of(name), Health)
    assert health is not None
    counts = [count for count in health.channels if count.key in feeder.num_sent]
    num_own = 0
    for count in counts:  # to the message, key by key; a service may hear what it says itself, too
        num_more = count.num_received + count.num_refused - feeder.num_sent[count.key]
        assert 0 <= num_more <= count.num_sent, (name, count)
        num_own += num_more
    received, refused = sum(count.num_received for count in counts), sum(count.num_refused for count in counts)
    num_sent, received = feeder.num_sent.total(), received - num_own
    return Outcome(name, len(counts), num_sent, received, refused, seconds, feeder.rss_warm_mib, _rss_mib())


def through_the_codec(num: int, payloads: Payloads, rng: random.Random) -> list[Outcome]:
    """Every entry of the codec with every message or key."""
    commands = [channel for channel in CHANNELS if channel.is_command]

    def decoded() -> None:
        message_type = rng.choice(MESSAGES)
        decode(message_type, payloads.of(message_type, is_command=False))

    def commanded() -> None:
        message_type = rng.choice(commands).message
        decode_command(message_type, payloads.of(message_type, is_command=True))

    def shown() -> None:
        channel = rng.choice(CHANNELS)
        to_text(channel.key_expr, payloads.of(channel.message, is_command=channel.is_command))

    def typed() -> None:
        channel = rng.choice(commands)
        text = payloads.of(channel.message, is_command=True).decode(errors=rng.choice(("replace", "surrogateescape")))
        from_text(channel.key_expr, text)

    outcomes = []
    for name, entry in (("decode", decoded), ("decode_command", commanded), ("to_text", shown), ("from_text", typed)):
        counts: Counter[bool] = Counter()
        rss_warm_mib, started_s = 0.0, time.monotonic()
        for number in range(num):
            try:
                entry()
                counts[True] += 1
            except CodecError:
                counts[False] += 1
            if number == int(_WARM_UP * num):
                rss_warm_mib = _rss_mib()
        seconds = time.monotonic() - started_s
        num_keys = len(MESSAGES) if entry is decoded else len(CHANNELS) if entry is shown else len(commands)
        outcomes.append(
            Outcome(f"codec {name}", num_keys, num, counts[True], counts[False], seconds, rss_warm_mib, _rss_mib())
        )
    return outcomes


def _shared_out(num: int) -> dict[str, int]:
    """How many each service gets; what is left over goes to the simulation."""
    shares = {name: _SHARES.get(name, _SHARE) for name in SERVICES if name != "player"}  # which ends when refused
    nums = {name: num * share // sum(shares.values()) for name, share in shares.items()}
    return {**nums, "sim": nums["sim"] + num - sum(nums.values())}


def _rss_mib() -> float:
    gc.collect()
    return psutil.Process().memory_info().rss / _MIB


def table(outcomes: list[Outcome]) -> str:
    """For docs/benchmarks."""
    lines = ["| service or entry | keys | payloads | received | refused | a payload (us) | RSS warm, end (MiB) |"]
    lines.append("|---|---|---|---|---|---|---|")
    for of in outcomes:
        pace, rss = 1e6 * of.seconds / of.num_sent, f"{of.rss_warm_mib:.0f}, {of.rss_end_mib:.0f}"
        counts = f"{of.num_sent:,} | {of.num_received:,} | {of.num_refused:,}"
        lines.append(f"| {of.name} | {of.num_keys} | {counts} | {pace:.0f} | {rss} |")
    total = [sum(getattr(of, name) for of in outcomes) for name in ("num_sent", "num_received", "num_refused")]
    lines.append(f"| **all** | | {total[0]:,} | {total[1]:,} | {total[2]:,} | | |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Writes JSON and the table; returns 1 if something does not balance."""
    parser = argparse.ArgumentParser(prog="python -m bench.fuzz_payloads")
    parser.add_argument("--num", type=int, default=1_000_000, help="payloads in all")
    parser.add_argument("--num-bus", type=int, default=20_000, help="of them over a real bus; 0 = none")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=_OUT)
    parser.add_argument("--merge", type=Path, nargs="+", default=[], help="only adds up the JSON of earlier runs")
    arguments = parser.parse_args()
    if arguments.merge:
        return _written([json.loads(path.read_text()) for path in arguments.merge], arguments.out)
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    rng = random.Random(arguments.seed)  # noqa: S311 - fuzzing
    outcomes: list[Outcome] = []
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        good = list(said_by(build("sim", folder), build("lidar", folder)))
        payloads = Payloads(rng, good)
        num_entry = (arguments.num - arguments.num_bus) // 10
        outcomes += through_the_codec(num_entry, payloads, rng)
        rest = arguments.num - arguments.num_bus - 4 * num_entry
        for name, num in _shared_out(rest).items():
            outcomes.append(through_the_runner(name, folder, num, payloads, good, rng))
            print(outcomes[-1], file=sys.stderr, flush=True)
        on_bus = over_the_bus(arguments.num_bus, payloads, folder) if arguments.num_bus else None
    result = {"seeds": [arguments.seed], "in_process": [asdict(of) for of in outcomes], "bus": on_bus}
    return _written([result], arguments.out)


def _written(results: list[dict[str, Any]], out: Path) -> int:
    """Adds up runs of other seeds, which may be done in turn, and writes what came of them."""
    by_name: dict[str, Outcome] = {}
    for each in (Outcome(**fields) for result in results for fields in result["in_process"]):
        by_name[each.name] = by_name[each.name].with_more(each) if each.name in by_name else each
    outcomes = list(by_name.values())
    bus = next((result["bus"] for result in results if result["bus"]), None)
    seeds = [seed for result in results for seed in result["seeds"]]
    merged = {"seeds": seeds, "in_process": [asdict(of) for of in outcomes], "bus": bus}
    (out / "bad_input.json").write_text(json.dumps(merged, indent=1) + "\n")
    print(table(outcomes))
    print(json.dumps(bus, indent=1))
    is_whole = bus is None or not bus["unbalanced"]
    return int(not (is_whole and all(of.is_balanced for of in outcomes)))


if __name__ == "__main__":
    sys.exit(main())
