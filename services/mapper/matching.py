"""The matcher of a configuration: planes, or a point method."""

from __future__ import annotations

from services.mapper.methods.registry import registration_class
from services.mapper.point_matcher import PointMatcher
from services.mapper.registration import ScanMatcher
from shared.runtime.config import MapperConfig


def make_matcher(config: MapperConfig) -> ScanMatcher:
    """The matcher that `method` of the configuration names.

    Raises:
        ConfigError: there is no such method.
        InputFileError: a method of one's own cannot be loaded.
    """
    if config.method == "plane":
        from services.mapper.planes.matcher import PlaneMatcher

        return PlaneMatcher(config)
    return PointMatcher(config, registration_class(config.method))
