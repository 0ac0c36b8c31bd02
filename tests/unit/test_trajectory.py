import numpy as np
import pytest

from services.player.trajectory import ChangeFoot, MoveTo, read_trajectory
from shared.errors import InputFileError

HEADER = "q1,q2,q3,q4,q5,q6,q7,q8\n"


def written(tmp_path, text):
    path = tmp_path / "moves.csv"
    path.write_text(text)
    return path


def test_rows_become_moves_with_their_lines(tmp_path):
    moves = read_trajectory(written(tmp_path, HEADER + "C,C,C,C,C,C,C,C\n\n0,0,0,0, 3.1416,0,0,-1e-1\n"))
    assert moves[0] == ChangeFoot(line=2)
    assert isinstance(moves[1], MoveTo)
    assert moves[1].line == 4
    np.testing.assert_array_equal(moves[1].q, [0, 0, 0, 0, 3.1416, 0, 0, -0.1])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", r":1: the header must be q1,q2"),
        ("a,b\n", r":1: the header must be q1,q2"),
        (HEADER, "0 rows after the header"),
        (HEADER + "1,2,3\n", ":2: has 3 values, 8 are needed"),
        (HEADER + "0,0,0,0,0,0,0,0\n0,0,nan,0,0,0,0,0\n", ":3: q3 is 'nan', must be a finite number"),
        (HEADER + "0,0,0,0,0,0,0,up\n", ":2: q8 is 'up'"),
        (HEADER + "C,C,C,C,C,C,C,0\n", ":2: q1 is 'C'"),
    ],
)
def test_what_is_no_trajectory(tmp_path, text, reason):
    with pytest.raises(InputFileError, match=reason):
        read_trajectory(written(tmp_path, text))


def test_a_missing_or_binary_file(tmp_path):
    with pytest.raises(InputFileError, match="No such file"):
        read_trajectory(tmp_path / "nothing.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(InputFileError, match=r"binary\.csv"):
        read_trajectory(tmp_path / "binary.csv")
