"""The real Rerun viewer, headless on loopback, as people would open a recording."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rerun_cli
from rerun.experimental import ViewerClient

from tests.support.processes import free_endpoint, wait_until

_BINARY = Path(rerun_cli.__file__).parent / "rerun"


@contextmanager
def viewer(path: Path) -> Iterator[Any]:
    """A viewer that has loaded this file."""
    port = free_endpoint().rpartition(":")[2]
    options = [
        "--headless",
        "--bind",
        "127.0.0.1",
        "--port",
        port,
        "--hide-welcome-screen",
        "--window-size",
        "1280x800",
    ]
    process = subprocess.Popen(
        [_BINARY, *options, "--memory-limit", "4GiB", path],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "WGPU_BACKEND": "vulkan"},
    )
    try:
        yield wait_until(lambda: _loaded(port, process), f"the viewer with {path}")
    finally:
        process.terminate()
        process.wait(30)


def _loaded(port: str, process: subprocess.Popen[bytes]) -> Any:
    assert process.poll() is None, "the viewer has ended; it needs a Vulkan driver (mesa-vulkan-drivers)"
    try:
        client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        state = client.get_state()
    except ConnectionError:
        return None
    is_ready = state.recordings and state.recordings[0].timelines and state.views and not state.loading
    return client if is_ready else None
