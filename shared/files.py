"""Files as texts and as bytes. Clouds are in `shared.cloud_files`, trajectories in `shared.trajectory_files`."""

from __future__ import annotations

from pathlib import Path

from shared.errors import InputFileError


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        InputFileError: it cannot be read or is not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise InputFileError(f"{path}: not UTF-8 text: {error}") from error


def read_bytes(path: Path) -> bytes:
    """The bytes of a file.

    Raises:
        InputFileError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror or error}") from error
