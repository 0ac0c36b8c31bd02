from functools import partial

import pytest

from shared.errors import InputFileError
from shared.files import read_bytes, read_text


def test_a_file_that_is_no_text_is_named(tmp_path):
    (tmp_path / "a.xml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputFileError, match=r"a\.xml: not UTF-8 text: "):
        read_text(tmp_path / "a.xml")


@pytest.mark.parametrize("read", [read_text, partial(read_bytes, max_bytes=10)])
def test_a_file_that_is_not_there_is_named(tmp_path, read):
    with pytest.raises(InputFileError, match=r"a\.xml: No such file"):
        read(tmp_path / "a.xml")
