"""Runs one Python peer over scans: `python peer_runner.py SCANS.npz PEER VOXEL_M [GUESSES]`, a JSON line a scan.

A script by itself, so that any interpreter can run it that has numpy and the peer. SCANS.npz has `points` (N, 3)
float32 in the lidar frame and `starts` (K + 1,). GUESSES as for `bench/pcl`: T_previous_scan of each scan. Lines hold
the scan's pose in the frame of the first, row-major, and wall and CPU milliseconds of all that is done with the points
from conversion and thinning on.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from typing import Any, Protocol

import numpy as np

Array = Any  # the peer's interpreter may have an older numpy
_NUM_NEIGHBOURS = 10


class Odometry(Protocol):
    """Takes scans in turn."""

    def step(self, points_m: Array, T_previous_scan: Array | None) -> Array:
        """T_first_scan (4, 4) of the next scan (N, 3) float64; the guess is None where there is no prior."""


class Trend:
    """Poses so far; guesses the next from the prior's step, or from the last step."""

    def __init__(self) -> None:
        self.pose, self._step = np.eye(4), np.eye(4)

    def guess(self, T_previous_scan: Array | None) -> Array:
        """T_first_scan as predicted."""
        return self.pose @ (self._step if T_previous_scan is None else T_previous_scan)

    def accept(self, T_first_scan: Array) -> Array:
        """Notes where the scan was found; its rotation is projected to the nearest."""
        U, _, Vt = np.linalg.svd(T_first_scan[:3, :3])
        pose = T_first_scan.copy()
        pose[:3, :3] = U @ Vt
        self._step, self.pose = np.linalg.inv(self.pose) @ pose, pose
        return pose


class Open3DScanToScan:
    """Open3D's registrations of each scan to the one before, pairs up to half a metre, begun where none has moved."""

    GATE_M = 0.5

    def __init__(self, method: str, voxel_m: float) -> None:
        self._o3d: Any = import_module("open3d")
        self._registration = self._o3d.pipelines.registration
        self._method, self._voxel_m = method, voxel_m
        self._trend = Trend()
        self._target: Any = None

    def step(self, points_m: Array, T_previous_scan: Array | None) -> Array:
        """See `Odometry`."""
        o3d = self._o3d
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m)).voxel_down_sample(self._voxel_m)
        if self._method == "point_to_plane":
            cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(_NUM_NEIGHBOURS))
        if self._method == "gicp":
            cloud.estimate_covariances(o3d.geometry.KDTreeSearchParamKNN(_NUM_NEIGHBOURS))
        T = np.eye(4) if self._target is None else self._align(cloud, T_previous_scan)
        self._target = cloud
        return self._trend.accept(self._trend.pose @ T)

    def _align(self, cloud: Any, T_previous_scan: Array | None) -> Array:
        registration, guess = self._registration, np.eye(4) if T_previous_scan is None else T_previous_scan
        if self._method == "gicp":
            estimation = registration.TransformationEstimationForGeneralizedICP()
            found = registration.registration_generalized_icp(cloud, self._target, self.GATE_M, guess, estimation)
        else:
            name = {"point_to_point": "PointToPoint", "point_to_plane": "PointToPlane"}[self._method]
            estimation = getattr(registration, f"TransformationEstimation{name}")()
            found = registration.registration_icp(cloud, self._target, self.GATE_M, guess, estimation)
        return np.array(found.transformation)


class SmallGicpScanToScan:
    """small_gicp's own defaults, each scan to the one before; VGICP with voxels twice as large as those that thin."""

    def __init__(self, method: str, voxel_m: float) -> None:
        self._small: Any = import_module("small_gicp")
        self._method, self._voxel_m = method, voxel_m
        self._trend = Trend()
        self._target: Any = None

    def step(self, points_m: Array, T_previous_scan: Array | None) -> Array:
        """See `Odometry`."""
        source, tree = self._small.preprocess_points(points_m, self._voxel_m, _NUM_NEIGHBOURS, 1)
        guess = np.eye(4) if T_previous_scan is None else T_previous_scan
        T = np.eye(4)
        if self._target is not None and self._method == "VGICP":
            T = self._small.align(self._target, source, guess).T_target_source
        elif self._target is not None:
            T = self._align(source, guess)
        self._target = self._as_target(source, tree)
        return self._trend.accept(self._trend.pose @ T)

    def _align(self, source: Any, guess: Array) -> Array:
        target, tree = self._target
        return self._small.align(target, source, tree, guess, registration_type=self._method).T_target_source

    def _as_target(self, source: Any, tree: Any) -> Any:
        if self._method != "VGICP":
            return source, tree
        voxels = self._small.GaussianVoxelMap(2 * self._voxel_m)
        voxels.insert(source)
        return voxels


class SmallGicpScanToMap:
    """GICP to a local map that is thinned, and its tree and covariances made anew, after each scan.

    VGICP: to small_gicp's incremental voxel map. Its incremental maps for GICP cannot be had from Python.
    """

    GATE_M = 0.3

    def __init__(self, method: str, voxel_m: float) -> None:
        self._small: Any = import_module("small_gicp")
        self._method, self._voxel_m = method, voxel_m
        self._trend, self._map_m = Trend(), np.empty((0, 4))
        self._target: Any = None
        self._voxels = self._small.GaussianVoxelMap(2 * voxel_m)

    def step(self, points_m: Array, T_previous_scan: Array | None) -> Array:
        """See `Odometry`."""
        source, _ = self._small.preprocess_points(points_m, self._voxel_m, _NUM_NEIGHBOURS, 1)
        guess = self._trend.guess(T_previous_scan)
        pose = self._trend.accept(guess if self._target is None else self._align(source, guess))
        if self._method == "VGICP":
            self._voxels.insert(source, pose)
            self._target = self._voxels
        else:
            together_m = np.vstack([self._map_m, source.points() @ pose.T])
            self._target = self._small.preprocess_points(together_m, self._voxel_m, _NUM_NEIGHBOURS, 1)
            self._map_m = self._target[0].points()
        return pose

    def _align(self, source: Any, guess: Array) -> Array:
        if self._method == "VGICP":
            return self._small.align(
                self._target, source, guess, max_correspondence_distance=self.GATE_M
            ).T_target_source
        target, tree = self._target
        kind = {"registration_type": "GICP", "max_correspondence_distance": self.GATE_M}
        return self._small.align(target, source, tree, guess, **kind).T_target_source


class KissIcp:
    """KISS-ICP with one thread and a voxel; a prior takes the place of its constant velocity."""

    def __init__(self, voxel_m: float) -> None:
        config = import_module("kiss_icp.config").KISSConfig()
        config.data.deskew, config.data.max_range, config.data.min_range = False, 100.0, 0.0
        config.mapping.voxel_size, config.registration.max_num_threads = voxel_m, 1
        self._odometry: Any = import_module("kiss_icp.kiss_icp").KissICP(config)

    def step(self, points_m: Array, T_previous_scan: Array | None) -> Array:
        """See `Odometry`."""
        if T_previous_scan is not None:
            self._odometry.last_delta = T_previous_scan
        self._odometry.register_frame(points_m, np.zeros(len(points_m)))
        return np.array(self._odometry.last_pose)


class GenzIcp:
    """GenZ-ICP with a voxel and what else it has by default; it takes no prior."""

    def __init__(self, voxel_m: float) -> None:
        config = import_module("genz_icp.config").GenZConfig()
        config.data.deskew, config.data.min_range = False, 0.0
        config.mapping.voxel_size = voxel_m
        self._odometry: Any = import_module("genz_icp.genz_icp").GenZICP(config)

    def step(self, points_m: Array, T_previous_scan: Array | None) -> Array:
        """See `Odometry`."""
        native = self._odometry._odometry
        native._register_frame(import_module("genz_icp.pybind").genz_icp_pybind._Vector3dVector(points_m))
        return np.array(native._last_pose())


PEERS: dict[str, tuple[str, Callable[[float], Odometry]]] = {
    "open3d_point_to_point": ("open3d", lambda voxel_m: Open3DScanToScan("point_to_point", voxel_m)),
    "open3d_point_to_plane": ("open3d", lambda voxel_m: Open3DScanToScan("point_to_plane", voxel_m)),
    "open3d_gicp": ("open3d", lambda voxel_m: Open3DScanToScan("gicp", voxel_m)),
    "small_gicp_gicp": ("small-gicp", lambda voxel_m: SmallGicpScanToScan("GICP", voxel_m)),
    "small_gicp_vgicp": ("small-gicp", lambda voxel_m: SmallGicpScanToScan("VGICP", voxel_m)),
    "small_gicp_gicp_map": ("small-gicp", lambda voxel_m: SmallGicpScanToMap("GICP", voxel_m)),
    "small_gicp_vgicp_map": ("small-gicp", lambda voxel_m: SmallGicpScanToMap("VGICP", voxel_m)),
    "kiss_icp": ("kiss-icp", KissIcp),
    "genz_icp": ("genz-icp", GenzIcp),
}
"""Its package, and what makes it from a voxel's edge in metres."""


def version_of(peer: str) -> str:
    """Of the package; Open3D has two names."""
    package = PEERS[peer][0]
    if package == "open3d":
        return f"open3d {import_module('open3d').__version__}"
    return f"{package} {version(package)}"


def main() -> None:
    """Runs the peer that is asked for."""
    scans, peer, voxel_m = np.load(sys.argv[1]), sys.argv[2], float(sys.argv[3])
    starts, points_m = scans["starts"], scans["points"].astype(np.float64)
    guesses = np.loadtxt(sys.argv[4]).reshape(-1, 4, 4) if len(sys.argv) > 4 else None
    odometry: Odometry = PEERS[peer][1](voxel_m)
    for k in range(len(starts) - 1):
        scan_m = points_m[starts[k] : starts[k + 1]].copy()
        started, cpu_started = time.perf_counter(), time.process_time()
        pose = odometry.step(scan_m, None if guesses is None or k == 0 else guesses[k])
        ms, cpu_ms = (1e3 * (time.perf_counter() - started), 1e3 * (time.process_time() - cpu_started))
        print(json.dumps({"ms": ms, "cpu_ms": cpu_ms, "pose": pose.ravel().tolist()}))


if __name__ == "__main__":
    main()
