import numpy as np
import pytest
from hypothesis import given, strategies as st

from shared.errors import InputFileError, TrajectoryFileError
from shared.geometry import SE3
from shared.trajectory_files import read_tum, write_tum

POSE = SE3.trans(1 / 3, 2.0, -3.0) @ SE3.rot("z", 0.1)


def test_tum_keeps_every_digit(tmp_path):
    write_tum(tmp_path / "poses.tum", [(1_000_000_001, POSE), (2_500_000_000, SE3.identity())])
    first, second = (tmp_path / "poses.tum").read_text().splitlines()
    stamp, *values = first.split()
    assert stamp == "1.000000001"
    assert [float(value) for value in values] == POSE.xyz_quat_xyzw.tolist()
    assert second == "2.500000000 0.0 0.0 0.0 0.0 0.0 0.0 1.0"


@given(stamps=st.sets(st.integers(0, 2**62), min_size=1, max_size=5), turn=st.floats(-3, 3), x=st.floats(-1e6, 1e6))
def test_what_is_written_is_read(tmp_path_factory, stamps, turn, x):
    path = tmp_path_factory.getbasetemp() / "round.tum"
    pose = SE3.trans(x) @ SE3.rot("y", turn)
    write_tum(path, [(stamp, pose) for stamp in sorted(stamps)])
    read = read_tum(path)
    assert [stamp for stamp, _ in read] == sorted(stamps)
    for _, again in read:
        np.testing.assert_allclose(again.matrix, pose.matrix, atol=1e-12)


def test_comments_empty_lines_and_other_spellings_of_numbers_are_read(tmp_path):
    (tmp_path / "a.tum").write_text("# t x y z\n\n1e0 1 2 3 0 0 0 1 # end\r\n\t1.5  1. 2 3 0 0 0 -1.0005\n")
    assert [stamp for stamp, _ in read_tum(tmp_path / "a.tum")] == [1_000_000_000, 1_500_000_000]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "a.tum: holds no poses"),
        ("# only this\n", "a.tum: holds no poses"),
        ("0 1 2 3 0 0 0\n", "a.tum: line 1: 7 values, must be 8"),
        ("0 0 0 0 0 0 0 1\n1 0 0 zero 0 0 0 1\n", "a.tum: line 2: .* are not eight numbers"),
        ("0 0 0 nan 0 0 0 1\n", "a.tum: line 1: .*finite"),
        ("nan 0 0 0 0 0 0 1\n", "a.tum: line 1: stamp nan must be within"),
        ("-1 0 0 0 0 0 0 1\n", "a.tum: line 1: stamp -1 must be within"),
        ("1e999999 0 0 0 0 0 0 1\n", "a.tum: line 1: stamp 1e999999 must be within"),
        ("0 0 0 0 0 0 0 1.01\n", "a.tum: line 1: quaternion length is 1.01"),
        ("0 0 0 0 0 0 0 1\n\n0 0 0 0 0 0 0 1\n", "a.tum: line 3: stamp 0 does not come after"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, reason):
    (tmp_path / "a.tum").write_text(text)
    with pytest.raises(TrajectoryFileError, match=reason):
        read_tum(tmp_path / "a.tum")


def test_a_file_that_is_not_there_is_wrong_usage(tmp_path):
    with pytest.raises(InputFileError, match="No such file"):
        read_tum(tmp_path / "a.tum")
