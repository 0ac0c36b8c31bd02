import math

import pytest
from hypothesis import given, strategies as st

from shared.xml_reading import XmlError, finite_numbers, root_of, vector, words


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1))
def test_numbers_are_read_as_they_are_written(values):
    assert finite_numbers(words(values), len(values), "here") == values
    assert not any(math.copysign(1.0, float(word)) < 0 for word in words([-0.0]).split())


@pytest.mark.parametrize(("text", "count"), [("1 2", 3), ("1 2 x", 3), ("", 1), ("inf", 1), ("1 nan", 2)])
def test_what_are_no_finite_numbers_is_refused(text, count):
    with pytest.raises(XmlError, match=f"here: needs {count} finite number"):
        finite_numbers(text, count, "here")


def test_a_vector_may_have_a_default():
    element = root_of("<a xyz='1 2 3'/>", "a")
    assert vector(element, "xyz", None, "a") == (1.0, 2.0, 3.0)
    assert vector(element, "rpy", (4.0, 5.0, 6.0), "a") == vector(None, "xyz", (4.0, 5.0, 6.0), "a") == (4.0, 5.0, 6.0)
    for missing in (element, None):
        with pytest.raises(XmlError, match="a: attribute 'rpy' is missing"):
            vector(missing, "rpy", None, "a")
