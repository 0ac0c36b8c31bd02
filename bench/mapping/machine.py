"""What a measurement was made on."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from pathlib import Path


def machine(versions: Sequence[str]) -> dict[str, str]:
    """Processor, system, interpreter, and the peers' versions, each once."""
    return {
        "machine": f"{_processor()}, {os.cpu_count()} cores, {platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "peers": ", ".join(dict.fromkeys(versions)),
    }


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())
