"""What the Hessian of a registration says about its result: covariance, directions left open, and what holds those."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from services.mapper.registration import RegistrationResult
from shared.geometry import SE3, homogeneous

AXES = ("x", "y", "z", "roll", "pitch", "yaw")
_MIN_SHARE = 0.01
"""A direction counts as determined from 1 % of all weight on; GICP gives sliding along a plane 0.1 %."""
_MIN_COMPONENT = 0.5
"""An axis is named when it makes up at least so much of the unit vector of an open direction."""


def covariance(result: RegistrationResult) -> NDArray[np.float64] | None:
    """Covariance (6, 6) of translation in metres, then rotation in radians, about the map's axes; None if undetermined.

    The inverse Hessian times the variance of a distance, as for any least squares: how well this scan repeats against
    this map. The error which the map itself has accumulated is not in it.
    """
    redundancy = result.num_inliers - len(AXES)
    if result.fitness_m2 is None or redundancy <= 0 or degenerate_axes(result.hessian):
        return None
    variance_m2 = result.fitness_m2 if result.sigma_m is None else result.sigma_m**2
    inverse = np.linalg.inv(result.hessian) * variance_m2 * result.num_inliers / redundancy
    symmetric: NDArray[np.float64] = (inverse + inverse.T) / 2.0
    return symmetric


def degenerate_axes(hessian: NDArray[np.float64]) -> tuple[str, ...]:
    """Names of the map's axes, out of `AXES`, along or about which the scan can move almost freely."""
    directions, _ = _open_directions(hessian)
    is_open: NDArray[np.bool_] = np.any(np.abs(directions) >= _MIN_COMPONENT, axis=1)
    return tuple(name for name, is_named in zip(AXES, is_open, strict=True) if is_named)


def held(result: RegistrationResult, T_map_predicted: SE3) -> SE3:
    """The pose found, but as predicted along and about the directions that the scan leaves open.

    Source: "solution remapping", Zhang, Kaess, Singh, "On degeneracy of optimization-based state estimation problems",
    ICRA 2016.
    """
    directions, scale = _open_directions(result.hessian)
    if directions.shape[1] == 0:
        return result.T_map_lidar
    predicted, found = T_map_predicted, result.T_map_lidar
    turn = SE3(found.rotation @ predicted.rotation.T, np.zeros(3))
    step = np.concatenate([found.translation - predicted.translation, turn.log()[3:]])
    scaled = step / scale
    kept = (scaled - directions @ (directions.T @ scaled)) * scale
    turned = SE3.exp(np.concatenate([np.zeros(3), kept[3:]])).rotation @ predicted.rotation
    return SE3.projected(homogeneous(turned, predicted.translation + kept[:3]))


def _open_directions(hessian: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors (6, K) of the open directions, of steps divided by the scale (6,), which is returned too.

    Rotations are scaled by the root mean square lever arm, so that both halves of the Hessian have the same trace w.
    Eigenvectors whose eigenvalue is below `_MIN_SHARE` of w are open. All are where the Hessian says nothing.
    """
    weight, rotation_weight = np.trace(hessian[:3, :3]), np.trace(hessian[3:, 3:])
    if not (weight > 0 and rotation_weight > 0):
        return np.eye(6), np.ones(6)
    scale = np.ones(6)
    scale[3:] = np.sqrt(weight / rotation_weight)
    scaled = hessian * scale * scale[:, np.newaxis]
    if _is_positive_definite(scaled - _MIN_SHARE * weight * np.eye(6)):  # as most are, and sooner told
        return np.empty((6, 0)), scale
    eigenvalues, eigenvectors = np.linalg.eigh(scaled)
    return eigenvectors[:, eigenvalues < _MIN_SHARE * weight], scale


def _is_positive_definite(matrix: NDArray[np.float64]) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
