"""Who takes part: our methods and the peers, and how each is started."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.mapping import peer_runner
from bench.mapping.scans import MAX_RANGE_M, MIN_RANGE_M

PCL_PROGRAM = Path("out") / "bench" / "pcl" / "scan_to_scan"
"""As `make -C bench/pcl` makes it."""
_OUR_RUNNER = "bench.mapping.our_runner"


@dataclass(frozen=True, slots=True)
class Contender:
    """A line of the table. key: the name that the runner of its family knows. takes_prior: whether it can use one."""

    family: str
    name: str
    key: str
    voxel_m: float
    takes_prior: bool = True

    @property
    def is_ours(self) -> bool:
        """Whether it runs in this repository's mapper."""
        return self.family == "ours"

    @property
    def label(self) -> str:
        """As the table has it."""
        return f"{self.name}, {self.voxel_m:g} m"


_OURS = (
    *(
        Contender("ours", f"**{method}**, scan to scan", f"{method}:scan", 0.1)
        for method in ("point_to_point", "point_to_plane", "gicp", "vgicp", "two_step")
    ),
    *(
        Contender("ours", f"**{method}**, scan to map", f"{method}:map", voxel_m)
        for method, voxel_m in (
            ("point_to_point", 0.05),
            ("point_to_plane", 0.05),
            ("gicp", 0.1),
            ("gicp", 0.05),
            ("vgicp", 0.05),
            ("two_step", 0.05),
            ("plane", 0.05),
        )
    ),
    Contender("ours", "**plane --refine**, scan to map", "plane:map:refine", 0.05),
)

_PEERS = (
    *(
        Contender("pcl", f"PCL {name}, scan to scan", key, voxel_m)
        for name, key in (("ICP point to point", "icp"), ("ICP point to plane", "icp_plane"), ("GICP", "gicp"))
        for voxel_m in (0.1, 0.05)
    ),
    Contender("python", "Open3D ICP point to point, scan to scan", "open3d_point_to_point", 0.1),
    Contender("python", "Open3D ICP point to plane, scan to scan", "open3d_point_to_plane", 0.1),
    Contender("python", "Open3D GICP, scan to scan", "open3d_gicp", 0.1),
    Contender("python", "small_gicp GICP, scan to scan", "small_gicp_gicp", 0.1),
    Contender("python", "small_gicp VGICP, scan to scan", "small_gicp_vgicp", 0.1),
    Contender("python", "small_gicp GICP, scan to map", "small_gicp_gicp_map", 0.1),
    Contender("python", "small_gicp GICP, scan to map", "small_gicp_gicp_map", 0.05),
    Contender("python", "small_gicp VGICP, scan to map", "small_gicp_vgicp_map", 0.15),
    Contender("python", "small_gicp VGICP, scan to map", "small_gicp_vgicp_map", 0.25),
    Contender("python", "KISS-ICP", "kiss_icp", 0.15),
    Contender("python", "KISS-ICP", "kiss_icp", 0.25),
    Contender("python", "GenZ-ICP", "genz_icp", 0.2, takes_prior=False),
    Contender("python", "GenZ-ICP", "genz_icp", 0.3, takes_prior=False),
)

CONTENDERS = (*_PEERS, *_OURS)


@dataclass(frozen=True, slots=True)
class Launcher:
    """Makes command lines. peers_python: an interpreter that has the Python peers this one has not."""

    peers_python: Path

    def command(self, contender: Contender, scans: Path, npz: Path, guesses: Path | None) -> list[str]:
        """What prints a JSON line a scan. scans: the folder of data0.pcd ...; npz: the same, gated."""
        last = [str(guesses)] if guesses is not None and contender.takes_prior else []
        voxel = f"{contender.voxel_m:g}"
        if contender.family == "pcl":
            gate = [str(MIN_RANGE_M), str(MAX_RANGE_M)]
            return [str(PCL_PROGRAM), str(scans), contender.key, voxel, *gate, *last]
        if contender.is_ours:
            return [sys.executable, "-m", _OUR_RUNNER, str(npz), contender.key, voxel, *last]
        python = self._python_with(contender.key)
        return [python or sys.executable, str(Path(peer_runner.__file__)), str(npz), contender.key, voxel, *last]

    def absence(self, contender: Contender) -> str | None:
        """Why a peer cannot run here, None if it can."""
        if contender.family == "pcl" and not PCL_PROGRAM.is_file():
            return "not built: install libpcl-dev, then make -C bench/pcl"
        if contender.family == "python" and self._python_with(contender.key) is None:
            return f"{peer_runner.PEERS[contender.key][0]} is not installed"
        return None

    def version(self, contender: Contender) -> str:
        """Name and version of a peer's library."""
        if contender.family == "pcl":
            return _output([str(PCL_PROGRAM), "--version"]) or "PCL"
        return _version(self._python_with(contender.key) or sys.executable, contender.key) or contender.key

    def _python_with(self, peer: str) -> str | None:
        return next((p for p in (sys.executable, str(self.peers_python)) if _version(p, peer) is not None), None)


_versions: dict[tuple[str, str], str | None] = {}


def _version(python: str, peer: str) -> str | None:
    key = (python, peer_runner.PEERS[peer][0])
    if key not in _versions:
        folder = str(Path(peer_runner.__file__).parent)
        code = (
            f"import sys; sys.path.insert(0, {folder!r}); import peer_runner; print(peer_runner.version_of({peer!r}))"
        )
        _versions[key] = _output([python, "-c", code])
    return _versions[key]


def _output(command: Sequence[str]) -> str | None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own command lines
    except OSError:
        return None
    return done.stdout.strip().splitlines()[-1] if done.returncode == 0 and done.stdout.strip() else None
