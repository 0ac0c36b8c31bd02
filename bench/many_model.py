"""What N robots cost, foretold from what one and two cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

WORK = {"sim": "tf", "lidar": "lidar/points", "mapper": "map/odometry"}
"""What a kind of process makes, one after the other: its CPU goes with their rate."""
NUM_FITTED, SLOW = 2, 0.2
"""Loads of at most so many robots at this pace are fitted; the others check."""
FULL = 0.8
"""Of a machine's cores or a link: above, delays grow without the mean being full."""


@dataclass(frozen=True, slots=True)
class Load:
    """Measured of N robots. real_time_factor: seconds of simulated time a second. cpu: seconds of CPU a second, by kind
    of process, all robots together.

    rate_hz: messages a second of one robot, the mean, by key. routed_hz, routed_mb_per_s: into and out of the router,
    each message once for its sender and once for each who takes it. num_lost: missed or dropped anywhere. delay: of a
    small message from one session of a robot through the router to another.
    """

    num_robots: int
    real_time_factor: float
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
    """work_s: seconds of CPU of each kind for one message it makes. idle: of the router, a second, whatever it does.
    hop_s, mb_s: of the router, for a message and for a megabyte that goes in or out. ones: the loads of one robot by
    its services, whose rates and sizes are taken for all robots.
    """

    work_s: dict[str, float]
    idle: float
    hop_s: float
    mb_s: float
    ones: dict[tuple[str, ...], Load]

    @classmethod
    def fitted(cls, loads: Sequence[Load]) -> Model:
        """From the loads of one and two robots.

        Raises:
            ValueError: there are none.
        """
        few = [load for load in loads if load.num_robots <= NUM_FITTED and load.real_time_factor == SLOW]
        if not few:
            raise ValueError("nothing was measured yet: run `python -m bench.many`")
        work_s = {}
        for kind in dict.fromkeys(kind for load in few for kind in load.kinds):
            those = [load for load in few if kind in load.kinds]
            work_s[kind] = sum(load.cpu[kind] for load in those) / sum(_num_made(load, kind) for load in those)
        routed = np.array([[1.0, load.routed_hz, load.routed_mb_per_s] for load in few])
        router_cpu = np.array([load.cpu["router"] for load in few])
        (idle, hop_s, mb_s), *_ = np.linalg.lstsq(routed, router_cpu, rcond=None)
        ones = {load.kinds: load for load in few if load.num_robots == 1}
        return cls(work_s, float(idle), float(hop_s), float(mb_s), ones)

    def cpu(self, num_robots: int, kinds: tuple[str, ...], real_time_factor: float = SLOW) -> dict[str, float]:
        """Seconds of CPU a second by kind, of so many robots with these services."""
        one, times = self.ones[kinds], num_robots * real_time_factor / SLOW
        cpu = {kind: times * one.rate_hz[WORK[kind]] * self.work_s[kind] for kind in kinds}
        return {**cpu, "router": self.idle + times * (self.hop_s * one.routed_hz + self.mb_s * one.routed_mb_per_s)}

    @property
    def whole(self) -> Load:
        """Of one robot with all services."""
        return max(self.ones.values(), key=lambda load: len(load.kinds))

    def prediction(self, num_robots: int, num_cores: float, link_mbps: float, real_time_factor: float) -> str:
        """What so many whole robots need, as text; also how many fit."""
        cpu = self.cpu(num_robots, self.whole.kinds, real_time_factor)
        total, mbps_each = sum(cpu.values()), self.whole.mbit_per_s * real_time_factor / SLOW
        mbps = num_robots * mbps_each
        cores_each = (total - self.idle) / num_robots
        fits = int((FULL * num_cores - self.idle) / cores_each), int(FULL * link_mbps / mbps_each)
        parts = ", ".join(f"{kind} {cores:.2f}" for kind, cores in cpu.items())
        return (
            f"{num_robots} robots need {total:.2f} of {num_cores:g} cores ({parts}); "
            f"a base that hears everything needs {mbps:.1f} of {link_mbps:g} Mbit/s.\n"
            f"Up to {FULL:.0%} are used by {fits[0]} robots on the machine, {fits[1]} on the link."
        )


def report(loads: Sequence[Load]) -> str:
    """Markdown: what was measured, beside what the model of one and two robots says."""
    model = Model.fitted(loads)
    lines = [
        "| robots | pace | services each | tf Hz | scans Hz | odometry Hz | router CPU | all CPU | model | error "
        "| lost | delay p50, p99 ms |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for load in sorted(loads, key=lambda load: (load.real_time_factor, len(load.kinds), load.num_robots)):
        total = sum(load.cpu.values())
        foretold = sum(model.cpu(load.num_robots, load.kinds, load.real_time_factor).values())
        rates = " | ".join(f"{load.rate_hz[key]:.1f}" if key in load.rate_hz else "" for key in WORK.values())
        lines.append(
            f"| {load.num_robots} | {load.real_time_factor:g} | {', '.join(load.kinds)} | {rates} | "
            f"{load.cpu['router']:.3f} | {total:.2f} | "
            f"{foretold:.2f} | {foretold / total - 1:+.0%} | {load.num_lost} | "
            f"{load.delay_p50_ms:.2f}, {load.delay_p99_ms:.2f} |"
        )
    costs = ", ".join(f"{kind} {1e3 * seconds:.2f} ms" for kind, seconds in model.work_s.items())
    return "\n".join(
        [
            *lines,
            "",
            f"CPU a message made: {costs}. Router: {1e3 * model.idle:.1f} ms a second, {1e6 * model.hop_s:.0f} us "
            f"a message in or out, {1e3 * model.mb_s:.2f} ms a MB. A whole robot at pace {SLOW:g} sends "
            f"{model.whole.mbit_per_s:.2f} Mbit/s.",
        ]
    )


def _num_made(load: Load, kind: str) -> float:
    """Messages a second that all robots' processes of this kind make."""
    return load.num_robots * load.rate_hz[WORK[kind]]
