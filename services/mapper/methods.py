"""The registration methods by the name they have in the configuration."""

from __future__ import annotations

from collections.abc import Callable

from services.mapper.gicp import Gicp
from services.mapper.registration import Points, Registration
from shared.runtime.config import MapperConfig

METHODS: dict[str, Callable[[Points, MapperConfig], Registration]] = {"gicp": Gicp}
"""Name -> builder on the target points (M, 3) in the map frame."""
