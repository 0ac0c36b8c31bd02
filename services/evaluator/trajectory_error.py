"""Errors of an estimated trajectory against the true one (ATE and RPE as in Sturm et al., IROS 2012, section V)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from shared.geometry import SE3


@dataclass(frozen=True, slots=True)
class TrajectoryError:
    """ate_rmse_m: position error after the first poses were laid together. rpe_*: error of each step between scans."""

    num_poses: int
    ate_rmse_m: float
    ate_max_m: float
    rpe_rmse_m: float
    rpe_rmse_rad: float


class TrajectoryComparison:
    """Compares pose by pose, online: `add` takes T_map_lidar as estimated and T_world_lidar as true at one time.

    The map frame is laid on the world by the first pair: `T_world_map`. No other alignment is made, so drift shows.
    """

    def __init__(self) -> None:
        self.T_world_map: SE3 | None = None
        self._previous: tuple[SE3, SE3] | None = None
        self._squared_m: list[float] = []
        self._steps_squared: list[tuple[float, float]] = []

    def add(self, T_map_lidar: SE3, T_world_lidar: SE3) -> SE3:
        """Takes one pair; returns what is left between estimate and truth, in the lidar's frame."""
        if self.T_world_map is None:
            self.T_world_map = T_world_lidar @ T_map_lidar.inv()
        error = T_world_lidar.inv() @ (self.T_world_map @ T_map_lidar)
        self._squared_m.append(float(error.translation @ error.translation))
        if self._previous is not None:
            estimated, true = self._previous
            step = (true.inv() @ T_world_lidar).inv() @ (estimated.inv() @ T_map_lidar)
            self._steps_squared.append((float(step.translation @ step.translation), step.angle_rad**2))
        self._previous = (T_map_lidar, T_world_lidar)
        return error

    def result(self) -> TrajectoryError:
        """The figures so far.

        Raises:
            ValueError: nothing was added yet.
        """
        if not self._squared_m:
            raise ValueError("no poses to compare")
        steps = np.array(self._steps_squared or [(0.0, 0.0)])
        return TrajectoryError(
            num_poses=len(self._squared_m),
            ate_rmse_m=float(np.sqrt(np.mean(self._squared_m))),
            ate_max_m=float(np.sqrt(np.max(self._squared_m))),
            rpe_rmse_m=float(np.sqrt(steps[:, 0].mean())),
            rpe_rmse_rad=float(np.sqrt(steps[:, 1].mean())),
        )


def compare_trajectories(T_map_lidar: Sequence[SE3], T_world_lidar: Sequence[SE3]) -> TrajectoryError:
    """The figures of whole trajectories, pose k against pose k."""
    comparison = TrajectoryComparison()
    for estimated, true in zip(T_map_lidar, T_world_lidar, strict=True):
        comparison.add(estimated, true)
    return comparison.result()
