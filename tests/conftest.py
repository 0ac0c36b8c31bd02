import itertools

import pytest
from hypothesis import settings

from shared.cloud_files import write_scan
from shared.runtime.config_loading import load_config
from tests.support.scans import NUM_SCANS, climb

# No deadline for a single example: on a busy machine it would fail tests of correct code.
settings.register_profile("project", deadline=None)
settings.load_profile("project")


@pytest.fixture(scope="session")
def recorded_scans(tmp_path_factory):
    """A folder with data0.pcd to data7.pcd, and T_world_lidar of each."""
    folder = tmp_path_factory.mktemp("scans")
    config = load_config(overrides=["seed=5"])
    scans = list(itertools.islice(climb(config, config.player.trajectory, 1, 3.2), NUM_SCANS))
    for k, (scan, _) in enumerate(scans):
        write_scan(folder / f"data{k}.pcd", scan)
    return folder, [T_world_lidar for _, T_world_lidar in scans]
