"""A sensor that is warm compiles nothing more, whatever it looks at; no two sensors share their noise."""

import pytest
from numba.core import event

from services.sensors.depth.camera import DepthCamera
from services.sensors.loading import load_lidar, sensor_seed, warm_up
from shared.runtime.sensor_config import DepthConfig, LidarConfig
from tests.support.sensing import ROBOT, ROOM, robot, structure, transforms

MODES = ["512x10", "2048x10"]


def numba_compiled(work):
    with event.install_recorder("numba:compile") as recorder:
        work()
    return [each.data["dispatcher"].py_func.__name__ for _, each in recorder.buffer]


@pytest.mark.parametrize("preset", ["ideal", "original", "datasheet"])
@pytest.mark.parametrize("mode", MODES)
def test_a_warm_lidar_compiles_nothing(preset, mode):
    config = LidarConfig.model_validate({"preset": preset, "mode": mode, "truth": True})
    warm_up(config)
    lidar = load_lidar(config, seed=1)
    lidar.set_robot(robot(ROBOT))
    lidar.set_structure(structure(ROOM))
    moments = [transforms(time_ms) for time_ms in (0, 50, 110)]
    assert numba_compiled(lambda: lidar.scan(moments if config.rolling_shutter else moments[:1])) == []


@pytest.mark.parametrize("preset", ["ideal", "original", "datasheet"])
def test_a_warm_camera_compiles_nothing(preset):
    config = DepthConfig.model_validate({"preset": preset, "frame": "lidar"})
    warm_up(config)
    camera = DepthCamera(config, 1, lambda: True)
    camera.set_robot(robot(ROBOT))
    camera.set_structure(structure(ROOM))
    assert numba_compiled(lambda: camera.add_transforms(transforms(0))) == []


def test_seeds_differ_by_sensor_and_by_the_seed_of_the_whole():
    seeds = {sensor_seed(seed, name) for seed in (1, 2) for name in ("lidar", "depth", "lidar/imu")}
    assert len(seeds) == 6
    assert sensor_seed(1, "lidar") == sensor_seed(1, "lidar")
