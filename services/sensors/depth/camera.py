"""The depth camera's facade: true transforms and descriptions in, depth images out at the camera's rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.sensors.depth.effects import StereoEffects
from services.sensors.depth.pinhole import Pinhole
from services.sensors.rays.backends import make_backend
from services.sensors.rays.interface import NO_FACE, Hits
from services.sensors.scene import Scene
from services.sensors.surroundings import Schedule, Surroundings
from shared.depth_points import points_of
from shared.messaging.messages import (
    CameraInfo,
    DepthImage,
    Message,
    PointCloud,
    RobotDescription,
    StructureDescription,
    Transforms,
)
from shared.runtime.sensor_config import DepthConfig

_SIGHT_PER_RANGE = 2.0
"""How far the scene is looked at, in maximum ranges: noise brings in what is beyond."""


class DepthCamera:
    """Looks at the structure, the robot and others, all pixels at once, at the stamp of the transforms it looks from.

    Time is divided into periods from zero on; the first transforms in each make its image, so a late one delays no
    other. seed: the same gives the same images. wants_points: whether somebody takes clouds now. other_robots: their
    names.
    """

    def __init__(
        self,
        config: DepthConfig,
        seed: int,
        wants_points: Callable[[], bool],
        name: str = "depth",
        other_robots: Sequence[str] = (),
    ) -> None:
        self._config = config
        self._camera = pinhole_of(config)
        self._wants_points = wants_points
        self._effects = StereoEffects(config, self._camera, seed)
        self._backend = make_backend(config.backend)
        self._surroundings = Surroundings(
            config.frame,
            sees_robot=config.self_hits,
            sensor_name=name,
            other_robots=other_robots,
            on_scene=self._backend.set_scene,
        )
        self._schedule = Schedule(config.rate_hz)
        self._num_images = 0

    def set_robot(self, description: RobotDescription) -> list[Message]:
        """Takes the robot's visible shapes; no image follows before the next transforms.

        Raises:
            InputFileError: the URDF is malformed, or has no link of the sensor's frame.
        """
        self._surroundings.set_robot(description)
        return []

    def set_structure(self, description: StructureDescription) -> list[Message]:
        """Takes the structure's shapes, all of one link; no image follows before the next transforms.

        Raises:
            InputFileError: the URDF is malformed, or has more than one link.
        """
        self._surroundings.set_structure(description)
        return []

    def set_other(self, name: str, description: RobotDescription) -> list[Message]:
        """Takes the visible shapes of another robot.

        Raises:
            InputFileError: the URDF is malformed.
        """
        self._surroundings.set_other(name, description)
        return []

    def place_other(self, name: str, transforms: Transforms) -> list[Message]:
        """Takes where another robot is from now on.

        Raises:
            MessageError: they do not begin at `world`, or leave out a link that can be seen.
        """
        self._surroundings.place_other(name, transforms)
        return []

    def add_transforms(self, transforms: Transforms) -> list[Message]:
        """An image and its intrinsics, if both descriptions are known and the period has none yet; a cloud if wanted.

        Raises:
            MessageError: the transforms do not connect the sensor with every link.
        """
        if self._surroundings.scene is None or not self._schedule.is_due(transforms.stamp_ns):
            return []
        image = self.image(self._surroundings.joined(transforms))
        self._num_images += 1
        messages: list[Message] = [image, self._info(image)]
        return [*messages, self._cloud(image)] if self._wants_points() else messages

    def image(self, transforms: Transforms) -> DepthImage:
        """The image from there, due or not.

        Raises:
            MessageError: the transforms do not connect the sensor with every link, or the descriptions are not known.
        """
        config = self._config
        poses = self._surroundings.poses([transforms], [transforms.stamp_ns])
        far_m = _SIGHT_PER_RANGE * config.max_range_m
        hits = self._backend.image(self._camera, poses, config.near_clip_m, far_m)
        truth = _truth(self._surroundings.scene, hits) if config.truth else {}
        return DepthImage(
            stamp_ns=transforms.stamp_ns,
            seq=self._num_images,
            frame=config.frame,
            height=self._camera.height,
            width=self._camera.width,
            depth_mm=self._effects.measure(hits, transforms.stamp_ns).reshape(-1),
            **truth,
        )

    @property
    def is_ready(self) -> bool:
        """Whether both descriptions are known."""
        return self._surroundings.scene is not None

    def _info(self, image: DepthImage) -> CameraInfo:
        camera = self._camera
        return CameraInfo(
            stamp_ns=image.stamp_ns,
            seq=image.seq,
            frame=image.frame,
            height=camera.height,
            width=camera.width,
            fx=camera.fx,
            fy=camera.fy,
            cx=camera.cx,
            cy=camera.cy,
        )

    def _cloud(self, image: DepthImage) -> PointCloud:
        camera = self._camera
        depth_mm = image.depth_mm.reshape(camera.height, camera.width)
        points_m = points_of(depth_mm, camera.fx, camera.fy, camera.cx, camera.cy)
        return PointCloud(stamp_ns=image.stamp_ns, seq=image.seq, frame=image.frame, points_m=points_m)


def pinhole_of(config: DepthConfig) -> Pinhole:
    """Square pixels, the optical axis through the middle of the image."""
    focal_px = config.width / 2 / math.tan(math.radians(config.horizontal_fov_deg) / 2)
    return Pinhole(config.height, config.width, focal_px, focal_px, (config.width - 1) / 2, (config.height - 1) / 2)


def _truth(scene: Scene | None, hits: Hits) -> dict[str, Any]:
    """What each pixel met, as the fields of a DepthImage."""
    assert scene is not None
    is_hit = hits.face != NO_FACE
    return {
        "member": _of_faces(scene.member_of_face, hits.face),
        "face": _of_faces(scene.face, hits.face),
        "true_depth_m": np.where(is_hit, hits.range_m, np.float32(0.0)).reshape(-1),
    }


def _of_faces(values: NDArray[np.int32], face: NDArray[np.int32]) -> NDArray[np.int32]:
    """The face's value for each pixel; NO_FACE is -1 and picks the last, itself."""
    table = np.append(values, np.int32(NO_FACE))
    return table[face.reshape(-1)]
