"""Checks what the pipeline stands on, and says of each missing thing what to do."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from shared.errors import BusError, ConfigError
from shared.messaging.bus import Bus, is_reachable
from shared.runtime.config import Config
from shared.runtime.config_loading import load_config
from shared.runtime.exit_codes import Exit

_MIN_DISK_GIB = 2.0
_MIN_SHM_MIB = 256
_LIBRARIES = ("zenoh", "numpy", "open3d", "small_gicp", "pybullet", "mcap", "rosbags", "rerun", "trimesh")


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the report. is_needed: without it the pipeline does not run."""

    name: str
    is_fine: bool
    text: str
    is_needed: bool = True


def run_doctor(config_path: Path, overrides: list[str], *, alive: str | None, is_json: bool) -> int:
    """Prints the report; exit code 1 if something needed is missing."""
    try:
        config = load_config(config_path, overrides, os.environ)
        checks = [Check("configuration", True, str(config_path))]
    except ConfigError as error:
        config = load_config()
        checks = [Check("configuration", False, str(error))]
    if alive is not None:
        checks = [_alive(config, alive)]
    else:
        checks += [_python(), *map(_library, _LIBRARIES), *map(_command, ("rerun", "zenoh")), _router(config)]
        checks += [_disk(config), _shared_memory()]
    if is_json:
        print(json.dumps([asdict(check) for check in checks], indent=2))
    else:
        for check in checks:
            mark = "ok     " if check.is_fine else ("MISSING" if check.is_needed else "note   ")
            print(f"{mark}  {check.name:<15} {check.text}")
    return Exit.FAILED if any(check.is_needed and not check.is_fine for check in checks) else Exit.FINE


def _python() -> Check:
    version = ".".join(map(str, sys.version_info[:3]))
    return Check("python", sys.version_info[:2] == (3, 11), f"{version} (3.11 is needed)")


def _library(name: str) -> Check:
    try:
        module = importlib.import_module(name)
    except (ImportError, OSError) as error:
        return Check(name, False, f"{error}; `make setup` installs it and the system libraries it needs")
    return Check(name, True, str(getattr(module, "__version__", "installed")))


def _command(name: str) -> Check:
    path = shutil.which(name, path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))
    return Check(f"{name} command", path is not None, path or "not found; `make setup` installs it")


def _router(config: Config) -> Check:
    is_up = is_reachable(config.bus.endpoint)
    text = f"{config.bus.endpoint} " + ("answers" if is_up else "is free; `hyrecro up` starts a router there")
    return Check("router", is_up, text, is_needed=False)


def _disk(config: Config) -> Check:
    folder = config.recorder.directory.resolve()
    while not folder.exists():
        folder = folder.parent
    free_gib = shutil.disk_usage(folder).free / 2**30
    return Check("disk", free_gib >= _MIN_DISK_GIB, f"{free_gib:.1f} GiB free for recordings (a climb takes about 0.5)")


def _shared_memory() -> Check:
    folder = "/dev/shm"  # noqa: S108 - where POSIX shared memory is
    size_mib = shutil.disk_usage(folder).total / 2**20
    return Check(
        "shared memory", size_mib >= _MIN_SHM_MIB, f"{folder} has {size_mib:.0f} MiB ({_MIN_SHM_MIB} are needed)"
    )


def _alive(config: Config, name: str) -> Check:
    try:
        with Bus(config.bus.model_copy(update={"connect_timeout_s": 3.0})) as bus:
            names = bus.alive()
    except BusError as error:
        return Check(name, False, str(error))
    return Check(name, name in names, "alive" if name in names else f"not alive; alive are: {' '.join(sorted(names))}")
