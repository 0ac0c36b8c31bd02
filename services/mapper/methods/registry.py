"""The point methods by the name they have in the configuration, and those of one's own by file and class."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from services.mapper.methods.anywhere import Anywhere
from services.mapper.methods.gicp import Gicp
from services.mapper.methods.point_to_plane import PointToPlane
from services.mapper.methods.point_to_point import PointToPoint
from services.mapper.methods.two_step import TwoStep
from services.mapper.methods.vgicp import Vgicp
from services.mapper.registration import Points, Registration
from shared.errors import ConfigError, InputFileError
from shared.runtime.config import MapperConfig

RegistrationClass = Callable[[Points, MapperConfig], Registration]
"""Builds a registration on the target points (M, 3) in the map frame."""

METHODS: dict[str, RegistrationClass] = {
    "gicp": Gicp,
    "global": Anywhere,
    "point_to_plane": PointToPlane,
    "point_to_point": PointToPoint,
    "two_step": TwoStep,
    "vgicp": Vgicp,
}


def registration_class(name: str) -> RegistrationClass:
    """The method of a name in METHODS, or of FILE.py:CLASS.

    Raises:
        ConfigError: no method has this name; the error lists those there are.
        InputFileError: the file cannot be read or run, or holds no such class, or one without `align`, `distances`.
    """
    if ":" in name:
        return _class_of_file(name)
    if name not in METHODS:
        raise ConfigError([f"mapper.method: no method '{name}'; use plane, {', '.join(METHODS)}, or FILE.py:CLASS"])
    return METHODS[name]


def _class_of_file(name: str) -> RegistrationClass:
    file, _, class_name = name.rpartition(":")
    found: Any = getattr(_module_of(Path(file)), class_name, None)
    if not isinstance(found, type):
        raise InputFileError(f"{file}: holds no class '{class_name}'")
    missing = [method for method in ("align", "distances") if not callable(getattr(found, method, None))]
    if missing:
        raise InputFileError(f"{file}: class '{class_name}' has no method {', '.join(missing)}")
    return found


def _module_of(path: Path) -> ModuleType:
    """Runs the file; what goes wrong in it is an error that names it."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise InputFileError(f"{path}: is no Python file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputFileError(f"{path}: {type(error).__name__}: {error}") from error
    return module
