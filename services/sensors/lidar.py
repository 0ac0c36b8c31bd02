"""The LiDAR's facade: true transforms and descriptions in, scans out at the sensor's rate in simulated time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from services.sensors.bodies import Labels, link_meshes
from services.sensors.noise import add_range_noise
from services.sensors.raycast import EmbreeRaycaster, Hits, Raycaster
from services.sensors.scan_pattern import scan_directions
from shared.errors import InputFileError, MessageError
from shared.messaging.frames import FrameTree
from shared.messaging.messages import LidarScan, RobotDescription, StructureDescription, Transforms
from shared.robot.description import Shape
from shared.robot.urdf import parse_urdf
from shared.runtime.config import LidarConfig

Seen = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Ring and column of rays."""

_MAX_INTENSITY = 255.0


class LidarScanner:
    """Scans the structure and the robot itself, all columns at once, at the stamp of the transforms it scans from.

    Time is divided into periods from zero on; the first transforms in each make its scan, so a late one delays no
    other. rng: the only source of noise; the same seed gives the same scans.
    """

    def __init__(self, config: LidarConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng
        self._directions = scan_directions(config)
        self._raycaster: Raycaster = EmbreeRaycaster(self._directions, config.min_range_m)
        self._period_ns = round(1e9 / config.rate_hz)
        self._last_period: int | None = None
        self._robot: tuple[Shape, ...] | None = None
        self._structure: tuple[Shape, ...] | None = None
        self._body_frames: tuple[str, ...] | None = None
        self._labels: Labels | None = None
        self._num_scans = 0

    def set_robot(self, description: RobotDescription) -> list[LidarScan]:
        """Takes the robot's visible shapes; no scan follows before the next transforms.

        Raises:
            InputFileError: the URDF is malformed, or has no link of the sensor's frame.
        """
        model = parse_urdf(description.urdf, "robot_description")
        if self._config.frame not in model.links:
            links = ", ".join(model.links)
            raise InputFileError(f"robot_description: no link '{self._config.frame}' for the lidar; links are {links}")
        self._robot = model.shapes
        self._set_bodies()
        return []

    def set_structure(self, description: StructureDescription) -> list[LidarScan]:
        """Takes the structure's shapes, all of one link; no scan follows before the next transforms.

        Raises:
            InputFileError: the URDF is malformed, or has more than one link.
        """
        model = parse_urdf(description.urdf, "structure_description")
        if len(model.links) > 1:
            raise InputFileError(f"structure_description: must be one link, is {', '.join(model.links)}")
        self._structure = tuple(replace(shape, link=description.frame) for shape in model.shapes)
        self._set_bodies()
        return []

    def add_transforms(self, transforms: Transforms) -> list[LidarScan]:
        """A scan, if both descriptions are known and its period has none yet.

        Raises:
            MessageError: the transforms do not connect the sensor with every body.
        """
        if self._body_frames is None or not self._is_due(transforms.stamp_ns):
            return []
        return [self.scan(transforms)[0]]

    def scan(self, transforms: Transforms) -> tuple[LidarScan, NDArray[np.int32]]:
        """A scan from there, due or not, and of each of its points the number of what it is on and of the face (N, 2).

        Raises:
            MessageError: the transforms do not connect the sensor with every body, or the descriptions are not known.
        """
        if self._body_frames is None or self._labels is None:
            raise MessageError("a scan needs the descriptions of robot and structure first")
        tree = FrameTree(transforms)
        T_world_body = [tree.T_root(frame) for frame in self._body_frames]
        hits = self._raycaster.cast(tree.T_root(self._config.frame), T_world_body)
        scan, seen = self._scan(hits, transforms.stamp_ns)
        return scan, self._labels.of(self._body_frames, hits.body[seen], hits.triangle[seen])

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the members and links that the numbers of `scan` stand for."""
        return () if self._labels is None else self._labels.names

    def _set_bodies(self) -> None:
        if self._robot is not None and self._structure is not None:
            shapes = (*self._structure, *self._robot)
            bodies = link_meshes(shapes)
            self._raycaster.set_bodies(tuple(bodies.values()))
            self._body_frames = tuple(bodies)
            self._labels = Labels(shapes)

    def _is_due(self, stamp_ns: int) -> bool:
        """Whether this stamp is in another period than the last: a later one, or an earlier one after a restart."""
        period = stamp_ns // self._period_ns
        is_due = period != self._last_period
        self._last_period = period
        return is_due

    def _scan(self, hits: Hits, stamp_ns: int) -> tuple[LidarScan, Seen]:
        """The scan, and the rays that are in it."""
        config = self._config
        range_m = add_range_noise(hits.range_m, config.range_noise_m, self._rng)
        ring, column = np.nonzero((range_m >= config.min_range_m) & (range_m <= config.max_range_m))
        self._num_scans += 1
        scan = LidarScan(
            stamp_ns=stamp_ns,
            seq=self._num_scans - 1,
            frame=config.frame,
            points_m=range_m[ring, column, np.newaxis] * self._directions[ring, column],
            intensity=diffuse_intensity(hits.cos_incidence[ring, column]),
            t_ns=np.zeros(len(ring), dtype=np.uint32),
            ring=ring.astype(np.uint16),
        )
        return scan, (ring, column)


def diffuse_intensity(cos_incidence: NDArray[np.float32]) -> NDArray[np.float32]:
    """What a white, perfectly diffuse surface returns, corrected for range: 255 head-on, 0 at grazing incidence.

    Source: Lambert's cosine law. The bodies have no reflectivity of their own.
    """
    return np.float32(_MAX_INTENSITY) * cos_incidence
