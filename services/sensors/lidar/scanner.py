"""The LiDAR's facade: true transforms and descriptions in, scans out at the sensor's rate in simulated time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from services.sensors.lidar.beams import Beams
from services.sensors.lidar.effects import LidarEffects, Returns
from services.sensors.lidar.footprint import Footprint
from services.sensors.rays.backends import make_backend
from services.sensors.scene import Scene
from services.sensors.surroundings import Schedule, Surroundings
from shared.errors import MessageError
from shared.messaging.messages import LidarScan, RobotDescription, StructureDescription, Transforms
from shared.runtime.sensor_config import LidarConfig

_MAX_WAITING = 10_000
"""Transforms of one revolution: their stamps may be a nanosecond apart."""
_NUM_BLOCKS = 32
"""Of columns, in each of which the robot's links stand still while the sensor moves: at most 3 ms of a revolution."""


class LidarScanner:
    """Scans the structure, the robot itself and other robots.

    Simulated time is divided into revolutions from zero on. A still sensor takes all columns of a revolution at once,
    from the first transforms in it. With `rolling_shutter` columns fire in turn: the scan of a revolution is stamped
    with its beginning, and taken when transforms from its end are there; a revolution that nothing is known of has
    none. seed: the same seed gives the same scans of the same moments. other_robots: their names.
    """

    def __init__(
        self, config: LidarConfig, beams: Beams, seed: int, name: str = "lidar", other_robots: Sequence[str] = ()
    ) -> None:
        self._config, self._beams, self._seed = config, beams, seed
        self._backend = make_backend(config.backend)
        self._surroundings = Surroundings(
            config.frame,
            sees_robot=config.self_hits,
            sensor_name=name,
            other_robots=other_robots,
            on_scene=self._set_scene,
        )
        self._effects: LidarEffects | None = None
        self._schedule = Schedule(config.rate_hz)
        self._period_ns = round(1e9 / config.rate_hz)
        self._footprint = Footprint(config.exit_m, float(np.deg2rad(config.divergence_deg)))
        self._waiting: list[Transforms] = []
        self._num_scans = 0

    def set_robot(self, description: RobotDescription) -> list[LidarScan]:
        """Takes the robot's visible shapes; no scan follows before the next transforms.

        Raises:
            InputFileError: the URDF is malformed, or has no link of the sensor's frame.
        """
        self._surroundings.set_robot(description)
        return []

    def set_structure(self, description: StructureDescription) -> list[LidarScan]:
        """Takes the structure's shapes, all of one link; no scan follows before the next transforms.

        Raises:
            InputFileError: the URDF is malformed, or has more than one link.
        """
        self._surroundings.set_structure(description)
        return []

    def set_other(self, name: str, description: RobotDescription) -> list[LidarScan]:
        """Takes the visible shapes of another robot.

        Raises:
            InputFileError: the URDF is malformed.
        """
        self._surroundings.set_other(name, description)
        return []

    def place_other(self, name: str, transforms: Transforms) -> list[LidarScan]:
        """Takes where another robot is from now on.

        Raises:
            MessageError: they do not begin at `world`, or leave out a link that can be seen.
        """
        self._surroundings.place_other(name, transforms)
        return []

    def add_transforms(self, transforms: Transforms) -> list[LidarScan]:
        """The scans that these transforms complete, if both descriptions are known.

        Raises:
            MessageError: the transforms do not connect the sensor with every link.
        """
        if self._effects is None:
            return []
        if self._config.rolling_shutter:
            return self._add_to_revolution(self._surroundings.joined(transforms))
        if not self._schedule.is_due(transforms.stamp_ns):
            return []
        return [self.scan([self._surroundings.joined(transforms)])]

    def scan(self, transforms: Sequence[Transforms], start_ns: int | None = None) -> LidarScan:
        """One scan from there, due or not.

        transforms: in the order of time; with a rolling shutter those that cover the revolution, before and after which
        everything is taken to stand still. start_ns: of the revolution, by default the first stamp.

        Raises:
            MessageError: the transforms do not connect the sensor with every link, or the descriptions are not known.
        """
        if self._effects is None:
            raise MessageError("a scan needs the descriptions of robot and structure first")
        config, start = self._config, transforms[0].stamp_ns if start_ns is None else start_ns
        t_ns = np.zeros(1, dtype=np.int64)
        if config.rolling_shutter:
            t_ns = np.arange(self._beams.num_columns) * self._period_ns // self._beams.num_columns
        if len(transforms) == 1:
            poses = self._surroundings.poses(transforms, [start])
        else:
            poses = self._surroundings.poses(transforms, start + t_ns, min(_NUM_BLOCKS, len(t_ns)))
        extent = (self._beams, poses, config.near_clip_m, config.max_range_m)
        hits = self._backend.scan(*extent)
        is_wide = self._footprint.exit_m > 0 or self._footprint.divergence_rad > 0
        edges = self._backend.edges(*extent, self._footprint) if is_wide else None
        return self._message(self._effects.apply(hits, edges, start), start, t_ns.astype(np.uint32))

    @property
    def is_ready(self) -> bool:
        """Whether both descriptions are known."""
        return self._effects is not None

    @property
    def member_names(self) -> tuple[str, ...]:
        """Names of the members and links that the numbers of a scan's truth stand for."""
        return () if self._surroundings.scene is None else self._surroundings.scene.names

    def _set_scene(self, scene: Scene) -> None:
        self._backend.set_scene(scene)
        self._effects = LidarEffects(self._config, self._beams, scene, self._surroundings.own_shapes, self._seed)
        self._waiting.clear()  # they may know nothing of who is in the scene now

    def _add_to_revolution(self, transforms: Transforms) -> list[LidarScan]:
        waiting, period_ns = self._waiting, self._period_ns
        if waiting and not 0 < transforms.stamp_ns - waiting[-1].stamp_ns <= period_ns:
            waiting.clear()  # time went back, or nothing is known of a whole revolution
        del waiting[:-_MAX_WAITING]
        waiting.append(transforms)
        start_ns = -(-waiting[0].stamp_ns // period_ns) * period_ns
        if transforms.stamp_ns < start_ns + period_ns:
            return []
        scan = self.scan(waiting, start_ns)
        while len(waiting) > 1 and waiting[1].stamp_ns <= start_ns + period_ns:
            waiting.pop(0)
        return [scan]

    def _message(self, returns: Returns, start_ns: int, t_ns: np.ndarray) -> LidarScan:
        self._num_scans += 1
        is_true, scene = self._config.truth, self._surroundings.scene
        assert scene is not None
        return LidarScan(
            stamp_ns=start_ns,
            seq=self._num_scans - 1,
            frame=self._config.frame,
            points_m=returns.points_m,
            intensity=returns.intensity,
            t_ns=t_ns[returns.column] if len(t_ns) > 1 else np.zeros(len(returns.ring), dtype=np.uint32),
            ring=returns.ring,
            member=scene.member_of_face[returns.face] if is_true else None,
            face=scene.face[returns.face] if is_true else None,
            true_range_m=returns.true_range_m if is_true else None,
        )
