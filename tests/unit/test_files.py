import numpy as np
import pytest
from pypcd4 import PointCloud

from shared.errors import InputFileError
from shared.files import read_text, write_pcd, write_tum
from shared.geometry import SE3


def test_pcd_reads_back(tmp_path):
    points = np.array([[1.0, -2.0, 3.5], [0.1, 0.2, 0.3]])
    write_pcd(tmp_path / "map.pcd", points)
    np.testing.assert_array_equal(
        PointCloud.from_path(tmp_path / "map.pcd").numpy(("x", "y", "z")), points.astype("f4")
    )


def test_tum_keeps_every_digit(tmp_path):
    pose = SE3.trans(1 / 3, 2.0, -3.0) @ SE3.rot("z", 0.1)
    write_tum(tmp_path / "poses.tum", [(1_000_000_001, pose), (2_500_000_000, SE3.identity())])
    first, second = (tmp_path / "poses.tum").read_text().splitlines()
    stamp, *values = first.split()
    assert stamp == "1.000000001"
    assert [float(value) for value in values] == pose.xyz_quat_xyzw.tolist()
    assert second == "2.500000000 0.0 0.0 0.0 0.0 0.0 0.0 1.0"


def test_a_file_that_is_no_text_is_named(tmp_path):
    (tmp_path / "a.xml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputFileError, match=r"a\.xml: not UTF-8 text: "):
        read_text(tmp_path / "a.xml")
