import numpy as np
import pytest

from services.sensors.scan_pattern import scan_directions
from shared.runtime.config import LidarConfig


def test_shape_and_unit_length():
    directions = scan_directions(LidarConfig())
    assert directions.shape == (128, 512, 3)
    assert directions.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)


def test_rings_go_from_top_to_bottom_in_equal_steps():
    elevations_deg = np.rad2deg(np.arcsin(scan_directions(LidarConfig())[:, 7, 2]))
    assert elevations_deg[0] == pytest.approx(22.8, abs=1e-4)
    assert elevations_deg[-1] == pytest.approx(-22.8, abs=1e-4)
    np.testing.assert_allclose(np.diff(elevations_deg), -45.6 / 127, atol=1e-4)


def test_columns_start_at_x_and_turn_clockwise():
    config = LidarConfig(num_columns=8, num_rings=1, max_elevation_deg=0.0, min_elevation_deg=-1.0)
    expected = [[1, 0, 0], [np.sqrt(0.5), -np.sqrt(0.5), 0], [0, -1, 0]]
    np.testing.assert_allclose(scan_directions(config)[0, :3], expected, atol=1e-7)
