"""What every section of the configuration is made of."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationInfo

CONFIGS_DIR = Path(__file__).parents[2] / "configs"

Vector3 = tuple[float, float, float]


class Section(BaseModel):
    """Base of every section: frozen, unknown keys forbidden, defaults checked too."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True)


def _existing_file(path: Path, info: ValidationInfo) -> Path:
    folders = [Path((info.context or {}).get("base_dir", CONFIGS_DIR)), CONFIGS_DIR]
    for folder in folders:
        if (folder / path).is_file():
            return (folder / path).resolve()
    raise ValueError(f"no such file: {path} (looked in {' and '.join(dict.fromkeys(map(str, folders)))})")


InputFile = Annotated[Path, AfterValidator(_existing_file)]
"""A file that exists; a relative path is looked up in the configuration file's folder, then in configs/."""
