import pytest

from services.mapper.matching import make_matcher
from services.mapper.methods.gicp import Gicp
from services.mapper.methods.registry import METHODS, registration_class
from services.mapper.point_matcher import PointMatcher
from shared.errors import ConfigError, InputFileError
from shared.runtime.config import MapperConfig

OWN = """
class Own:
    def __init__(self, target, config):
        pass
    def align(self, points, T, gate):
        return "aligned"
    def distances(self, points):
        pass
"""


def test_methods_are_known_by_name():
    assert registration_class("gicp") is Gicp
    assert {"point_to_point", "point_to_plane", "gicp", "vgicp"} <= set(METHODS)


def test_a_method_of_ones_own_is_loaded_from_its_file(tmp_path):
    file = tmp_path / "own.py"
    file.write_text(OWN)
    assert registration_class(f"{file}:Own")(None, None).align(None, None, None) == "aligned"


def test_an_unknown_name_is_told_those_there_are():
    with pytest.raises(ConfigError, match=r"no method 'icp'; use plane, gicp, .*, or FILE.py:CLASS"):
        registration_class("icp")


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        (None, "Own", r"own\.py: is no Python file"),
        (OWN, "Other", r"own\.py: holds no class 'Other'"),
        (OWN, "__name__", r"own\.py: holds no class"),
        (OWN.replace("align", "aligned"), "Own", r"own\.py: class 'Own' has no method align$"),
        ("import nothing_of_this_name", "Own", r"own\.py: ModuleNotFoundError: No module"),
        ("class Own(:", "Own", r"own\.py: SyntaxError"),
    ],
)
def test_a_file_that_cannot_be_used_is_named_with_the_reason(tmp_path, text, name, said):
    file = tmp_path / "own.py"
    if text is not None:
        file.write_text(text)
    with pytest.raises(InputFileError, match=said):
        registration_class(f"{file}:{name}")


def test_a_matcher_is_made_of_the_configuration():
    assert isinstance(make_matcher(MapperConfig(method="gicp")), PointMatcher)
    with pytest.raises(ConfigError, match="no method 'nothing'"):
        make_matcher(MapperConfig(method="nothing"))
