"""The sets of scans that are made when none are named: a shipped climb, and the same made hard."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from shared.runtime.config import CONFIGS_DIR

_CLIMB = CONFIGS_DIR / "trajectories" / "climb.csv"
SETS: dict[str, list[str]] = {
    "climb": ["--scans", "75", "--seed", "1"],
    "climb_hard": [
        *("--scans", "25", "--seed", "7", "--config", "realistic"),
        *("--set", "sensors.lidar.range_noise_m=0.03"),
    ],
}
"""Options of `hyrecro simulate`. climb: 8 mm noise. climb_hard: 30 mm, over 40 degrees between two scans, and a robot
that does not know itself exactly, whose leg odometry is the prior."""


def made_sets(cache: Path) -> list[Path]:
    """Folders of the sets, made where they are not there yet."""
    folders = []
    for name, options in SETS.items():
        folder = cache / name
        if not (folder / "truth.tum").is_file():
            _python("cli.main", "simulate", str(_CLIMB), "--out", str(folder), *options)
            if "realistic" in options:
                _python("bench.leg_prior", str(folder))
        folders.append(folder)
    return folders


def _python(module: str, *arguments: str) -> None:
    subprocess.run([sys.executable, "-m", module, *arguments], check=True)  # noqa: S603 - our own modules
