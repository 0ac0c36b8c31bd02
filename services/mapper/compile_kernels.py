"""Compiles the mapper's kernels once, at set-up, so that no first run waits for them: `python -m ...compile_kernels`.

Numba does not see a change in a kernel that another file's kernel calls, so what was kept is removed first.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from services.mapper.methods.registry import METHODS
from services.mapper.warming import warm_up
from shared.runtime.config import MapperConfig


def compile_kernels() -> None:
    """Maps a few scans by each method."""
    for kept in Path(__file__).parent.rglob("__pycache__/*.nb[ic]"):
        kept.unlink()
    for method in ("plane", *METHODS):
        warm_up(MapperConfig(method=method, num_outlier_neighbours=4), is_refining=True)


if __name__ == "__main__":
    print("compiling the mapper's kernels ...", file=sys.stderr, flush=True)
    started_s = time.perf_counter()
    compile_kernels()
    print(f"compiled in {time.perf_counter() - started_s:.0f} s", file=sys.stderr)
