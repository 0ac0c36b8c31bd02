"""Maps recorded scans: the mapper's facade fed from files, as fast as it can, and what came out as figures."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cli.scan_sources import ScanSource, Warn
from services.evaluator.map_accuracy import num_points_off_planes
from services.mapper.in_turn import InTurn
from services.mapper.mapper import Mapper, Registered
from services.mapper.node import inputs_of, load_mapper
from services.mapper.priors.interface import Prior
from services.mapper.warming import warm_up
from services.mapper.whole_run import refined
from shared.geometry import SE3
from shared.messaging.messages import (
    Event,
    MapStatus,
    Message,
    Odometry,
    PlaneMap,
)
from shared.runtime.config import Config
from shared.runtime.node import Addressed

_NO_MAPS = {"map_rate_hz": 1e-9}
"""The map is asked for at the end, not published on the way."""
OnScan = Callable[[Mapper, list[Message]], None]


@dataclass(slots=True)
class MapRun:
    """What mapping gave.

    poses: T_map_sensor of each scan, which begins with the identity; of a lost scan as predicted. is_tracked: of each.
    statuses: one a scan. map_points_m (N, 3): in the map frame. refine_ms: what the refinement took, 0 without.
    num_loops: returns that closed one.
    """

    stamps_ns: list[int] = field(default_factory=list)
    poses: list[SE3] = field(default_factory=list)
    statuses: list[MapStatus] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    map_points_m: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    planes: PlaneMap | None = None
    refine_ms: float = 0.0
    num_loops: int = 0

    @property
    def is_tracked(self) -> list[bool]:
        """Whether each pose was found rather than predicted."""
        return [status.is_tracking for status in self.statuses]


def map_scans(
    config: Config,
    source: ScanSource,
    *,
    prior: Prior | None = None,
    is_refining: bool = False,
    warn: Warn = lambda _: None,
    on_scan: OnScan = lambda _mapper, _messages: None,
) -> MapRun:
    """Maps every scan of a source, in one process and without a bus.

    prior: instead of the configured one. is_refining: afterwards all poses and planes are estimated together, for which
    the scans are kept in memory, a quarter of a megabyte each at 512x128.
    """
    mapper = load_mapper(config.mapper.model_copy(update=_NO_MAPS), time.perf_counter_ns, prior=prior)
    if is_refining:
        warm_up(config.mapper, is_refining=True)
    run = MapRun()
    kept: list[Registered] = []

    def note(said: list[Message]) -> None:
        if said and is_refining and mapper.last is not None:
            kept.append(mapper.last)
        if said:
            on_scan(mapper, said)

    in_turn = InTurn(mapper, config.mapper, note)
    inputs = inputs_of(mapper, in_turn, config.mapper, time.perf_counter_ns)
    handlers = {channel.message: handler for channel, handler in inputs.items()}
    for message in source.messages(warn):
        for answer in handlers[type(message)](message):
            _note(run, answer, source)
    for answer in in_turn.finish():
        _note(run, answer, source)
    run.map_points_m, run.planes = mapper.target.points_m, mapper.map_planes()
    if is_refining and any(run.is_tracked):
        started_ns = time.perf_counter_ns()
        whole = refined(kept, mapper.target.matcher, config.mapper)
        run.refine_ms = (time.perf_counter_ns() - started_ns) / 1e6
        run.num_loops, run.map_points_m = whole.num_loops, whole.map_points_m
        since_taken = [scan.T_map_sensor.inv() @ pose for scan, pose in zip(kept, run.poses, strict=True)]
        run.poses = [pose @ step for pose, step in zip(whole.poses, since_taken, strict=True)]
    return run


def figures_of(run: MapRun, config: Config) -> dict[str, Any]:
    """What `hyrecro map --json` prints."""
    ms = np.array([status.registration_ms for status in run.statuses] or [np.nan])
    fitness = [status.fitness for status in run.statuses if status.is_tracking and status.fitness is not None]
    lost = [status.scan_seq for status in run.statuses if not status.is_tracking]
    settings = config.evaluator
    return {
        "method": config.mapper.method,
        "scans": len(run.statuses),
        "total_ms": float(ms.sum()) + run.refine_ms,
        "ms_per_scan_p50": float(np.percentile(ms, 50)),
        "ms_per_scan_p99": float(np.percentile(ms, 99)),
        "fitness_mean": float(np.mean(fitness)) if fitness else None,
        "map_points": len(run.map_points_m),
        "off_plane_points": num_points_off_planes(
            run.map_points_m,
            num_planes=settings.num_planes,
            distance_m=settings.plane_distance_m,
            seed=config.seed,
        ),
        "lost_scans": len(lost),
        "lost_scan_numbers": lost,
        "degenerate_scans": sum(bool(status.degenerate_axes) for status in run.statuses),
        "planes": len(run.planes.planes) if run.planes else 0,
        "refine_ms": run.refine_ms,
        "closed_loops": run.num_loops,
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def _note(run: MapRun, message: Message | Addressed, source: ScanSource) -> None:
    match message:
        case Odometry():
            run.poses.append(SE3.from_xyz_quat_xyzw(message.T_frame_child))
        case MapStatus():
            run.statuses.append(message)
            run.stamps_ns.append(source.stamp_ns(message))
            if len(run.poses) < len(run.statuses):
                run.poses.append(SE3.identity())
        case Event():
            run.events.append(message)
