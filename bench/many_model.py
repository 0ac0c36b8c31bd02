"""What N robots cost, foretold from what one and two cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WORK = {"sim": "tf", "lidar": "lidar/points", "mapper": "map/odometry"}
"""What a kind of process makes, one after the other: its CPU goes with their rate."""
NUM_FITTED = 2
"""Loads of at most so many robots are fitted; the others check."""
FULL = 0.8
"""Of a machine's cores or a link: above, delays grow without the mean being full."""


@dataclass(frozen=True, slots=True)
class Load:
    """Measured of N robots. cpu: seconds of CPU a second, by kind of process, all robots together.

    rate_hz: messages a second of one robot, the mean, by key. routed_hz, routed_mb_per_s: into and out of the router,
    each message once for its sender and once for each who takes it. num_lost: missed or dropped anywhere. delay: of a
    small message from one session of a robot through the router to another.
    """

    num_robots: int
    kinds: tuple[str, ...]
    cpu: dict[str, float]
    rate_hz: dict[str, float]
    bytes_a_message: dict[str, int]
    routed_hz: float
    routed_mb_per_s: float
    num_lost: int
    delay_p50_ms: float
    delay_p99_ms: float

    @property
    def mbit_per_s(self) -> float:
        """Of one robot, if a base on another host hears every key."""
        return sum(hz * self.bytes_a_message.get(key, 0) for key, hz in self.rate_hz.items()) * 8e-6


@dataclass(frozen=True, slots=True)
class Model:
    """work_s: seconds of CPU of each kind for one message it makes. hop_s, mb_s: of the router, for a message and for
    a megabyte that goes in or out. one: the load of one whole robot, whose rates and sizes are taken for all.
    """

    work_s: dict[str, float]
    hop_s: float
    mb_s: float
    one: Load

    @classmethod
    def fitted(cls, loads: Sequence[Load]) -> Model:
        """From the loads of one and two robots.

        Raises:
            ValueError: there are none.
        """
        few = [load for load in loads if load.num_robots <= NUM_FITTED]
        if not few:
            raise ValueError("nothing was measured yet: run `python -m bench.many`")
        work_s = {}
        for kind in dict.fromkeys(kind for load in few for kind in load.kinds):
            those = [load for load in few if kind in load.kinds]
            work_s[kind] = sum(load.cpu[kind] for load in those) / sum(_num_made(load, kind) for load in those)
        routed = np.array([[load.routed_hz, load.routed_mb_per_s] for load in few])
        router_cpu = np.array([load.cpu["router"] for load in few])
        (hop_s, mb_s), *_ = np.linalg.lstsq(routed, router_cpu, rcond=None)
        one = max((load for load in few if load.num_robots == 1), key=lambda load: len(load.kinds))
        return cls(work_s, float(hop_s), float(mb_s), one)

    def cpu(self, num_robots: int, kinds: Sequence[str], alike: Load) -> dict[str, float]:
        """Seconds of CPU a second by kind, of so many robots that do as one of `alike` was asked to do."""
        share = num_robots / alike.num_robots
        cpu = {kind: num_robots * alike.rate_hz[WORK[kind]] * self.work_s[kind] for kind in kinds}
        return {**cpu, "router": share * (self.hop_s * alike.routed_hz + self.mb_s * alike.routed_mb_per_s)}

    def prediction(self, num_robots: int, num_cores: float, link_mbps: float) -> str:
        """What so many whole robots need, as text; also how many fit."""
        cpu = self.cpu(num_robots, self.one.kinds, self.one)
        total, mbps = sum(cpu.values()), num_robots * self.one.mbit_per_s
        fits = int(FULL * num_cores / (total / num_robots)), int(FULL * link_mbps / self.one.mbit_per_s)
        parts = ", ".join(f"{kind} {cores:.2f}" for kind, cores in cpu.items())
        return (
            f"{num_robots} robots need {total:.2f} of {num_cores:g} cores ({parts}); "
            f"a base that hears everything needs {mbps:.1f} of {link_mbps:g} Mbit/s.\n"
            f"Up to {FULL:.0%} are used by {fits[0]} robots on the machine, {fits[1]} on the link."
        )


def report(loads: Sequence[Load]) -> str:
    """Markdown: what was measured, beside what the model of one and two robots says."""
    model = Model.fitted(loads)
    alike = {load.kinds: load for load in loads if load.num_robots == 1}
    lines = [
        "| robots | services each | tf Hz | scans Hz | odometry Hz | router CPU | all CPU | model | error | lost | "
        "delay p50, p99 ms |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for load in sorted(loads, key=lambda load: (len(load.kinds), load.num_robots)):
        total = sum(load.cpu.values())
        foretold = sum(model.cpu(load.num_robots, load.kinds, alike[load.kinds]).values())
        rates = " | ".join(f"{load.rate_hz[key]:.1f}" if key in load.rate_hz else "" for key in WORK.values())
        lines.append(
            f"| {load.num_robots} | {', '.join(load.kinds)} | {rates} | {load.cpu['router']:.3f} | {total:.2f} | "
            f"{foretold:.2f} | {foretold / total - 1:+.0%} | {load.num_lost} | "
            f"{load.delay_p50_ms:.2f}, {load.delay_p99_ms:.2f} |"
        )
    costs = ", ".join(f"{kind} {1e3 * seconds:.2f} ms" for kind, seconds in model.work_s.items())
    return "\n".join(
        [
            *lines,
            "",
            f"CPU a message made: {costs}. Router: {1e6 * model.hop_s:.0f} us a message in or out, "
            f"{1e3 * model.mb_s:.2f} ms a MB. A whole robot sends {model.one.mbit_per_s:.2f} Mbit/s.",
        ]
    )


def _num_made(load: Load, kind: str) -> float:
    """Messages a second that all robots' processes of this kind make."""
    return load.num_robots * load.rate_hz[WORK[kind]]
