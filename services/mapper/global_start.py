"""Where a scan lies in a target when nothing is known: surfaces that face the same ways, then planes laid on planes.

The directions of the surfaces give the rotations; along each of three directions, the positions of the surfaces in scan
and target are correlated, and the highest peaks are tried in every combination. No pose is believed for this alone:
each says how much of the scan then lies where the target has points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import small_gicp
from numpy.typing import NDArray

from services.mapper.registration import Points
from services.mapper.surface_directions import Directions, rotations_between, surface_directions
from services.mapper.voxel_map import voxel_centroids
from services.mapper.voxel_table import VoxelTable
from shared.geometry import SE3

Float = NDArray[np.float64]

_NUM_NEIGHBOURS = 16
_ALONG_COSINE = 0.9
"""A surface counts along a direction when its normal is within 26 degrees of it."""
_MIN_ALONG = 0.02
"""Where fewer points than this share do, all points are taken."""
_BIN_M = 0.03
_SMOOTHING = np.array([1.0, 3.0, 4.0, 3.0, 1.0]) / 12.0
"""A kernel as wide as 3 cm of noise."""
_NUM_PEAKS = 6
_NUM_TRIED_POINTS = 400
_CELL_M = 0.1
_MIN_SINE = 0.3
"""Between axes that span space well enough."""
_DISTINCT_M = 0.15
_DISTINCT_RAD = 0.15


@dataclass(frozen=True, slots=True)
class Candidate:
    """T_map_lidar, and the share 0..1 of the scan's points that then have target points within a cell or two."""

    T_map_lidar: SE3
    share: float


class GlobalStart:
    """Finds scans in the target points (M, 3), which are in the map frame."""

    def __init__(self, target_map_m: Points, voxel_size_m: float) -> None:
        self._voxel_size_m = voxel_size_m
        self._target_m, self._normals = _with_normals(target_map_m, voxel_size_m)
        self._directions = surface_directions(self._normals)
        self._cells = _dilated_cells(self._target_m)

    def candidates(
        self,
        points_lidar_m: Points,
        max_candidates: int,
        near: SE3 | None = None,
        max_angle_rad: float = np.pi,
        max_distance_m: float = np.inf,
    ) -> list[Candidate]:
        """Distinct poses of a scan (N, 3), the best first; none where the surfaces of either face one way only.

        near: only poses within max_angle_rad and max_distance_m of this one are tried.
        """
        scan_m, normals = _with_normals(points_lidar_m, self._voxel_size_m)
        tried_m = scan_m[:: max(1, len(scan_m) // _NUM_TRIED_POINTS)]
        rotations, shifts_m, shares = [np.empty((0, 3, 3))], [np.empty((0, 3))], [np.empty(0)]
        for R in rotations_between(surface_directions(normals), self._directions):
            if near is not None and _angle_rad(near.rotation.T @ R) > max_angle_rad:
                continue
            found_m = self._shifts(scan_m @ R.T, normals @ R.T)
            if near is not None:
                found_m = found_m[np.linalg.norm(found_m - near.translation, axis=1) <= max_distance_m]
            rotations.append(np.broadcast_to(R, (len(found_m), 3, 3)))
            shifts_m.append(found_m)
            shares.append(self._shares(tried_m @ R.T, found_m))
        return distinct(np.concatenate(rotations), np.concatenate(shifts_m), np.concatenate(shares), max_candidates)

    def _shifts(self, turned_m: Float, normals: Float) -> Float:
        """Translations (T, 3) for a scan that is turned already: every combination of the peaks along three axes."""
        axes = _three_axes(self._directions)
        peaks_m = [self._peaks(turned_m, normals, axis) for axis in axes]
        along_m = np.stack(np.meshgrid(*peaks_m, indexing="ij"), axis=-1).reshape(-1, 3)
        return np.asarray(np.linalg.solve(axes, along_m.T).T, dtype=np.float64)

    def _peaks(self, turned_m: Float, normals: Float, axis: Float) -> Float:
        """The shifts along an axis at which most of the surfaces that face this way come to lie on each other."""
        source_m = _positions(turned_m, normals, axis)
        target_m = _positions(self._target_m, self._normals, axis)
        low_m = min(source_m.min(), target_m.min())
        num_bins = int((max(source_m.max(), target_m.max()) - low_m) / _BIN_M) + len(_SMOOTHING)
        source, target = (_density(positions_m - low_m, num_bins) for positions_m in (source_m, target_m))
        overlap = np.fft.fftshift(np.fft.irfft(np.conj(source) * target, 2 * num_bins))
        peaks = np.flatnonzero((overlap >= np.roll(overlap, 1)) & (overlap > np.roll(overlap, -1)))
        highest = peaks[np.argsort(-overlap[peaks], kind="stable")[:_NUM_PEAKS]]
        return np.asarray((highest - num_bins) * _BIN_M, dtype=np.float64)

    def _shares(self, turned_m: Float, shifts_m: Float) -> Float:
        """Of the points (K, 3), for each shift (T, 3): (T,)."""
        moved_m = turned_m[np.newaxis] + shifts_m[:, np.newaxis]
        is_on = self._cells.has(moved_m.reshape(-1, 3)).reshape(len(shifts_m), len(turned_m))
        shares: Float = is_on.mean(axis=1)
        return shares


def _density(positions_m: Float, num_bins: int) -> NDArray[np.complex128]:
    """The spectrum of how many points lie where, as roots, so that the largest surface does not decide alone."""
    counts = np.bincount((positions_m / _BIN_M).astype(np.int64), minlength=num_bins)
    return np.fft.rfft(np.convolve(np.sqrt(counts), _SMOOTHING, "same"), 2 * num_bins)


def distinct(rotations: Float, shifts_m: Float, shares: Float, max_candidates: int) -> list[Candidate]:
    """The poses of the highest shares that are not next to a better one."""
    chosen: list[int] = []
    for i in np.argsort(-shares, kind="stable").tolist():
        is_near = np.linalg.norm(shifts_m[chosen] - shifts_m[i], axis=1) < _DISTINCT_M
        same = [j for j, near in zip(chosen, is_near, strict=True) if near]
        if all(_angle_rad(rotations[j].T @ rotations[i]) > _DISTINCT_RAD for j in same):
            chosen.append(i)
        if len(chosen) == max_candidates:
            break
    return [Candidate(SE3(rotations[i], shifts_m[i]), float(shares[i])) for i in chosen]


def _with_normals(points_m: Points, voxel_size_m: float) -> tuple[Float, Float]:
    """The thinned points (M, 3) and their normals, up to sign."""
    thinned_m = voxel_centroids(points_m, voxel_size_m)
    cloud = small_gicp.PointCloud(thinned_m)
    small_gicp.estimate_normals(cloud, None, _NUM_NEIGHBOURS, 1)
    return thinned_m, np.ascontiguousarray(cloud.normals()[:, :3])


def _positions(points_m: Float, normals: Float, axis: Float) -> Float:
    """Where along an axis the surfaces lie that face along it; all points where hardly any do."""
    is_along = np.abs(normals @ axis) > _ALONG_COSINE
    chosen_m = points_m[is_along] if is_along.mean() > _MIN_ALONG else points_m
    return np.asarray(chosen_m @ axis, dtype=np.float64)


def _three_axes(directions: Directions) -> Float:
    """Three directions (3, 3), as rows, none of which is near the plane of the others."""
    first, *others = directions.axes
    second = next(axis for axis in others if np.linalg.norm(np.cross(first, axis)) > _MIN_SINE)
    across = np.cross(first, second)
    third = next((axis for axis in others if abs(across @ axis) > _MIN_SINE**2), across)
    return np.array([first, second, third])


def _dilated_cells(points_m: Float) -> VoxelTable:
    """The cells that hold points, and their neighbours."""
    centres_m = (np.floor(voxel_centroids(points_m, _CELL_M) / _CELL_M) + 0.5) * _CELL_M
    table = VoxelTable(_CELL_M, max_voxels=27 * len(centres_m) + 1)
    steps_m = _CELL_M * np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    table.rows((centres_m[:, np.newaxis] + steps_m).reshape(-1, 3))
    return table


def _angle_rad(R: Float) -> float:
    return float(np.arccos(np.clip((np.trace(R) - 1.0) / 2.0, -1.0, 1.0)))
