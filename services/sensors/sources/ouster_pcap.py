"""Packets of a real Ouster LiDAR: a pcap and its metadata, decoded by ouster-sdk in an environment of its own."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from services.sensors.sources import frames
from services.sensors.sources.interface import Recording
from shared.errors import InputFileError
from shared.messaging.messages import Imu, LidarScan, Measurement

PYTHON_VARIABLE = "OUSTER_PYTHON"
"""Names another interpreter that has ouster-sdk. It does not begin with HYRECRO_: those are settings."""
DEFAULT_PYTHON = Path(__file__).parents[3] / ".venv-ouster" / "bin" / "python"
_CHILD = Path(__file__).with_name("ouster_child.py")
_MESSAGES: dict[str, type[Measurement]] = {"scan": LidarScan, "imu": Imu}
_END_TIMEOUT_S = 5.0


def read_pcap(pcap: Path, metadata: Path, python: Path, frame: str) -> Recording:
    """The scans and the IMU's readings of a pcap as the sensor sent them, in `frame`, with the sensor's own stamps.

    python: an interpreter that has ouster-sdk. Closing the generator ends it.

    Raises:
        InputFileError: a file is missing or not what it should be, or there is no such interpreter.
    """
    _check_files(pcap, metadata, python)
    seq = dict.fromkeys(_MESSAGES, 0)
    with _decoder(pcap, metadata, python) as stream:
        for read in frames.read_frames(stream):
            yield _MESSAGES[read.kind](stamp_ns=read.stamp_ns, seq=seq[read.kind], frame=frame, **read.arrays)
            seq[read.kind] += 1
    return ""


def metadata_of(pcap: Path) -> Path:
    """Where the metadata of a pcap stand if nobody says otherwise: beside it."""
    return pcap.with_suffix(".json")


def _check_files(pcap: Path, metadata: Path, python: Path) -> None:
    if not pcap.is_file():
        raise InputFileError(f"{pcap}: no such file")
    if not metadata.is_file():
        raise InputFileError(f"{metadata}: no such file: the metadata of {pcap.name}; --metadata FILE names another")
    if not os.access(python, os.X_OK):
        raise InputFileError(
            f"{pcap}: reading it needs ouster-sdk, and {python} is missing: make ouster, or set {PYTHON_VARIABLE}"
        )


@contextmanager
def _decoder(pcap: Path, metadata: Path, python: Path) -> Generator[IO[bytes], None, None]:
    """The decoder's output. It has a session of its own: Ctrl-C is ours, it ends when its pipe is closed."""
    with tempfile.TemporaryFile() as stderr:
        process = subprocess.Popen(  # noqa: S603 - our own script
            [python, "-I", _CHILD, pcap, metadata],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=stderr,
            start_new_session=True,
        )
        assert process.stdout is not None
        try:
            yield process.stdout
        except frames.FrameError as error:
            reason = str(error) or _last_words(process, stderr)
            raise InputFileError(f"{pcap}: {reason}") from error
        finally:
            process.stdout.close()
            process.kill()
            process.wait()


def _last_words(process: subprocess.Popen[bytes], stderr: IO[bytes]) -> str:
    """Why a decoder ended that did not say it itself."""
    assert process.stdout is not None
    process.stdout.close()
    code = process.wait(_END_TIMEOUT_S)
    stderr.seek(0)
    lines = stderr.read().decode(errors="replace").strip().splitlines()
    words = lines[-1] if lines else f"exit code {code}"
    if "No module named" in words:
        return f"the interpreter in use has no ouster-sdk ({words}): make ouster, or set {PYTHON_VARIABLE}"
    return f"the decoder failed: {words}"
