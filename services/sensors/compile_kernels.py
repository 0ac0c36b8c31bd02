"""Compiles the sensors' kernels once, at set-up, so that no first run waits for them: `python -m ...compile_kernels`.

Numba keeps what it compiled beside the sources, or in the user's cache where these cannot be written. It does not see a
change in a kernel that another file's kernel calls, so what was kept is removed first.
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from services.sensors.loading import warm_up
from shared.runtime.sensor_config import DepthConfig, LidarConfig

_KINDS: tuple[type[LidarConfig] | type[DepthConfig], ...] = (LidarConfig, DepthConfig)


def compile_kernels() -> None:
    """Takes a scan and an image as each preset has them: LiDAR and camera at once, then what the two missed."""
    for kept in Path(__file__).parent.rglob("__pycache__/*.nb[ic]"):
        kept.unlink()
    with ProcessPoolExecutor(len(_KINDS), mp_context=get_context("spawn")) as processes:
        for _ in processes.map(_warm_up, _KINDS):
            pass
    for kind in _KINDS:
        _warm_up(kind)


def _warm_up(kind: type[LidarConfig] | type[DepthConfig]) -> None:
    for preset in ("original", "datasheet"):
        warm_up(kind.model_validate({"preset": preset}))


if __name__ == "__main__":
    print("compiling the sensors' kernels ...", file=sys.stderr, flush=True)
    started_s = time.perf_counter()
    compile_kernels()
    print(f"compiled in {time.perf_counter() - started_s:.0f} s", file=sys.stderr)
