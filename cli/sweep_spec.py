"""What a sweep runs over: its file, and the cases it means."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from shared.errors import ConfigError
from shared.files import read_text
from shared.runtime.section import InputFile, Section
from shared.yaml_reading import YamlError, load_yaml

Positive = Annotated[float, Field(gt=0)]


class Simulation(Section):
    """Scans to make, see `hyrecro simulate`."""

    trajectory: InputFile
    num_scans: int | None = Field(None, ge=1)


class SweepSpec(Section):
    """Every combination of the lists is a case. Paths are relative to the file's folder."""

    data: tuple[Path, ...] = ()
    """Folders with data0.pcd ... and, to be scored, truth.tum."""
    simulate: Simulation | None = None
    """Instead of data: made once for each noise and seed."""
    structure: InputFile | None = None
    """What maps are compared with; None: with `simulate` the configured one, with `data` none."""
    methods: tuple[str, ...] = Field(min_length=1)
    voxels: tuple[Positive, ...] = ()
    """Edges in metres; none: as configured."""
    range_noise_m: tuple[Annotated[float, Field(ge=0)], ...] = ()
    """Of the simulated LiDAR; none: as configured."""
    seeds: tuple[Annotated[int, Field(ge=0)], ...] = (1,)
    refine: bool = False
    set_: tuple[str, ...] = Field((), alias="set")
    """Settings of every case, SECTION.KEY=VALUE."""

    @model_validator(mode="after")
    def _is_whole(self) -> SweepSpec:
        if bool(self.data) == (self.simulate is not None):
            raise ValueError("must have either data or simulate")
        if self.range_noise_m and self.simulate is None:
            raise ValueError("range_noise_m is of simulated scans: it needs simulate")
        return self


@dataclass(frozen=True, slots=True)
class Scans:
    """A folder of scans: given, or to be made of a trajectory with this noise and seed; settings apply then too."""

    folder: str
    trajectory: str | None = None
    num_scans: int | None = None
    range_noise_m: float | None = None
    seed: int | None = None
    settings: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """A folder that is given has one; one that is made is named by what it is made of."""
        if self.trajectory is None:
            return Path(self.folder).name
        noise = "" if self.range_noise_m is None else f"_noise{self.range_noise_m:g}"
        return f"{Path(self.trajectory).stem}{noise}_seed{self.seed}_{_digest(self)}"


@dataclass(frozen=True, slots=True)
class Case:
    """One run of the mapper over one folder of scans."""

    scans: Scans
    method: str
    voxel_m: float | None
    seed: int
    refine: bool
    structure: str | None
    settings: tuple[str, ...]

    @property
    def name(self) -> str:
        """For files: it differs wherever anything of the case does."""
        method = "".join(letter if letter.isalnum() or letter == "_" else "-" for letter in Path(self.method).name)
        voxel = "" if self.voxel_m is None else f"_voxel{self.voxel_m:g}"
        return f"{self.scans.name}_{method}{voxel}_seed{self.seed}_{_digest(self)}"


def read_spec(path: Path) -> SweepSpec:
    """The specification in a YAML file.

    Raises:
        InputFileError: the file cannot be read. ConfigError: with one line for each problem: file, key, rule.
    """
    try:
        tree = load_yaml(read_text(path), str(path))
        return SweepSpec.model_validate(tree, context={"base_dir": path.resolve().parent})
    except YamlError as error:
        raise ConfigError([str(error)]) from error
    except ValidationError as error:
        raise ConfigError([f"{path}: {_problem_text(dict(details))}" for details in error.errors()]) from error


def cases_of(spec: SweepSpec, spec_folder: Path, structure: Path) -> list[Case]:
    """All cases, those over the same scans together. structure: the configured one.

    Raises:
        ConfigError: with one line for each folder of data that is not there.
    """
    folders = [(spec_folder / folder).resolve() for folder in spec.data]
    if missing := [f"data: {folder}: no such folder" for folder in folders if not folder.is_dir()]:
        raise ConfigError(missing)
    compared = spec.structure or (structure if spec.simulate is not None else None)
    cases = []
    for (scans, seed), method, voxel_m in product(_scans(spec, folders), spec.methods, spec.voxels or (None,)):
        name = None if compared is None else str(compared)
        cases.append(Case(scans, method, voxel_m, seed, spec.refine, name, spec.set_))
    return cases


def _scans(spec: SweepSpec, folders: list[Path]) -> list[tuple[Scans, int]]:
    """What is mapped, with the seed of each."""
    if spec.simulate is None:
        return [(Scans(str(folder)), seed) for folder, seed in product(folders, spec.seeds)]
    trajectory, num_scans = str(spec.simulate.trajectory), spec.simulate.num_scans
    pairs = product(spec.range_noise_m or (None,), spec.seeds)
    return [(Scans("", trajectory, num_scans, noise_m, seed, spec.set_), seed) for noise_m, seed in pairs]


def _digest(value: Scans | Case) -> str:
    text = json.dumps(asdict(value), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _problem_text(details: dict[str, Any]) -> str:
    key = ".".join(str(part) for part in details["loc"])
    rule = str(details["msg"]).removeprefix("Value error, ").removeprefix("Input ")
    if details["type"] == "extra_forbidden":
        known = ", ".join(field.alias or name for name, field in SweepSpec.model_fields.items())
        rule = f"unknown key; known are {known}"
    return f"{key}: {rule}" if key else rule
