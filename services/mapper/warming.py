"""Takes a mapper's kernels through all they do once, so that no scan of a run waits for them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.mapper import Mapper
from services.mapper.whole_run import refined
from shared.geometry import SE3
from shared.messaging.messages import CameraInfo, DepthImage
from shared.messaging.scans import scan_of
from shared.runtime.config import MapperConfig

_STEP = SE3.exp([0.05, 0.02, 0.01, 0.01, 0.02, 0.05])
_SIZE_PX = 64


def warm_up(config: MapperConfig, *, is_refining: bool = False) -> None:
    """Maps a few scans and an image of a room with a mapper of these settings; is_refining: then refines the run."""
    ranges = {"min_range_m": 0.1, "max_range_m": 20.0, "crop_m": None, "map_file": None}
    mapper = Mapper(config.model_copy(update=ranges))
    pose = SE3.identity()
    run = []
    for k in range(4):
        points_m = pose.inv().apply(_room(k))
        mapper.add_scan(scan_of(points_m, k * 10**8, k, t_ns=np.arange(len(points_m)) % 1000))
        run.append(mapper.last)
        pose = pose @ _STEP
    mapper.map_planes()
    if is_refining:
        refined([scan for scan in run if scan is not None], mapper.target.matcher, config)
    centre_px = (_SIZE_PX - 1) / 2
    mapper.set_camera(
        CameraInfo(
            stamp_ns=10**9,
            seq=0,
            frame="depth_optical",
            height=_SIZE_PX,
            width=_SIZE_PX,
            fx=_SIZE_PX / 2,
            fy=_SIZE_PX / 2,
            cx=centre_px,
            cy=centre_px,
        )
    )
    depth_mm = np.full(_SIZE_PX**2, 1500, dtype=np.uint16)
    image = DepthImage(stamp_ns=10**9, seq=0, frame="depth_optical", height=_SIZE_PX, width=_SIZE_PX, depth_mm=depth_mm)
    mapper.add_image(image)


def _room(seed: int) -> NDArray[np.float32]:
    """Points (N, 3) on the walls of a room of 4 x 3 x 2.4 m with a post, in rows as a LiDAR measures them."""
    azimuth, elevation = np.meshgrid(np.linspace(-np.pi, np.pi, 256), np.linspace(0.5, -0.5, 48))
    rays = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    ).reshape(-1, 3)
    with np.errstate(divide="ignore"):
        to_walls_m = (np.array([2.0, 1.5, 1.2]) / np.abs(rays)).min(axis=1)
        to_post_m = np.where((rays[:, 0] > 0) & (np.abs(rays[:, 1] / rays[:, 0]) < 0.1), 1.0 / rays[:, 0], np.inf)
    noise_m = 0.005 * np.random.default_rng(seed).standard_normal(len(rays))
    points: NDArray[np.float32] = (rays * (np.minimum(to_walls_m, to_post_m) + noise_m)[:, np.newaxis]).astype(
        np.float32
    )
    return points
