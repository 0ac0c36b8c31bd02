"""Runs the cases of a sweep on all cores; what is done already is not done again."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cli.sweep_spec import Case, Scans
from shared.errors import HyrecroError
from shared.runtime.exit_codes import Exit

_POLL_S = 0.1
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Cases run side by side, each on one core."""
_MAX_REASON = 500

Note = Callable[[str], None]


class StoppedError(HyrecroError):
    """The user ended the sweep while a case was running."""


class Sweep:
    """The cases, and the folder that holds what was found: data/ for made scans, cases/ with a JSON each."""

    def __init__(self, cases: Sequence[Case], out: Path, is_stopping: Callable[[], bool] = lambda: False) -> None:
        self._cases = list(cases)
        self._out = out
        self._is_stopping = is_stopping
        (out / "cases").mkdir(parents=True, exist_ok=True)
        (out / "data").mkdir(exist_ok=True)

    def run(self, num_jobs: int, on_done: Note) -> None:
        """Runs what is not done yet, `num_jobs` at a time; on_done gets a line each. Cases that failed run again."""
        waiting = [case for case in self._cases if not self._is_done(case)]
        scans = [each for each in dict.fromkeys(case.scans for case in waiting) if each.trajectory is not None]
        self._all(self._make, [each for each in scans if not self._folder(each).is_dir()], num_jobs, on_done)
        self._all(self._run_case, waiting, num_jobs, on_done)

    def results(self) -> list[dict[str, Any]]:
        """What was found, in the order of the cases; those that did not run are not there."""
        paths = [self._result(case) for case in self._cases]
        return [json.loads(path.read_text(encoding="utf-8")) for path in paths if path.is_file()]

    @property
    def num_done(self) -> int:
        """Cases that ended well."""
        return sum(self._is_done(case) for case in self._cases)

    # ---- one piece of work

    def _all(self, work: Callable[[Any], str], items: Sequence[Any], num_jobs: int, on_done: Note) -> None:
        with ThreadPoolExecutor(num_jobs) as pool:  # each thread only waits for a process
            for future in as_completed([pool.submit(self._unless_stopped, work, item) for item in items]):
                if (text := future.result()) is not None:
                    on_done(text)

    def _unless_stopped(self, work: Callable[[Any], str], item: Any) -> str | None:
        if self._is_stopping():
            return None
        try:
            return work(item)
        except StoppedError:
            return None
        except HyrecroError as error:
            return f"failed: {error}"

    def _make(self, scans: Scans) -> str:
        """Under another name until it is whole."""
        folder = self._folder(scans)
        partial = folder.with_name(f"{folder.name}.partial")
        shutil.rmtree(partial, ignore_errors=True)
        arguments = ["simulate", str(scans.trajectory), "--out", str(partial), "--seed", str(scans.seed)]
        arguments += ["--scans", str(scans.num_scans)] if scans.num_scans is not None else []
        settings = list(scans.settings)
        settings += [f"sensors.lidar.range_noise_m={scans.range_noise_m}"] if scans.range_noise_m is not None else []
        self._hyrecro([*arguments, *_set(settings)])
        partial.rename(folder)
        return f"made {folder.name}"

    def _run_case(self, case: Case) -> str:
        result: dict[str, Any] = {"case": asdict(case), "name": case.name, "map": None, "eval": None, "error": None}
        try:
            with TemporaryDirectory(prefix="hyrecro_sweep_") as folder:
                result["map"], result["eval"] = self._mapped(case, Path(folder))
        except StoppedError:
            raise
        except HyrecroError as error:
            result["error"] = str(error)
        path = self._result(case)
        partial = path.with_suffix(".partial")
        partial.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        partial.replace(path)
        return case.name if result["error"] is None else f"{case.name} failed: {result['error']}"

    def _mapped(self, case: Case, folder: Path) -> tuple[dict[str, Any], dict[str, Any] | None]:
        """What `map` and `eval` say; no eval of scans without truth."""
        scans, settings = self._folder(case.scans), _set([*case.settings, f"seed={case.seed}"])
        poses, cloud = folder / "trajectory.tum", folder / "map.ply"
        arguments = ["map", str(scans), "--method", case.method, "--json", "--map", str(cloud)]
        arguments += ["--trajectory", str(poses)]
        arguments += ["--voxel", str(case.voxel_m)] if case.voxel_m is not None else []
        arguments += ["--refine"] if case.refine else []
        mapped = json.loads(self._hyrecro([*arguments, *settings]))
        truth = scans / "truth.tum"
        if not truth.is_file():
            return mapped, None
        arguments = ["eval", "--estimate", str(poses), "--truth", str(truth), "--json"]
        arguments += ["--map", str(cloud), "--structure", case.structure] if case.structure is not None else []
        return mapped, json.loads(self._hyrecro([*arguments, *_set(list(case.settings))]))

    def _hyrecro(self, arguments: list[str]) -> str:
        """What the command prints to stdout; a partial result counts.

        Raises:
            HyrecroError: with its last words, where it failed. StoppedError: the user ended the sweep.
        """
        command = [sys.executable, "-P", "-m", "cli.main", *arguments]
        pipe = subprocess.PIPE
        process = subprocess.Popen(  # noqa: S603 - our own command, no shell
            command, stdout=pipe, stderr=pipe, text=True, env={**os.environ, **_ONE_THREAD}
        )
        with process:
            out, err = _communicated(process, self._is_stopping)
        if process.returncode not in (Exit.FINE, Exit.PARTIAL):
            words = err.strip().splitlines() or [f"{arguments[0]} ended with {process.returncode}"]
            raise HyrecroError(words[-1].removeprefix("hyrecro: ")[:_MAX_REASON])
        return out

    def _folder(self, scans: Scans) -> Path:
        return Path(scans.folder) if scans.trajectory is None else self._out.resolve() / "data" / scans.name

    def _result(self, case: Case) -> Path:
        return self._out / "cases" / f"{case.name}.json"

    def _is_done(self, case: Case) -> bool:
        path = self._result(case)
        return path.is_file() and json.loads(path.read_text(encoding="utf-8"))["error"] is None


def _communicated(process: subprocess.Popen[str], is_stopping: Callable[[], bool]) -> tuple[str, str]:
    while True:
        try:
            return process.communicate(timeout=_POLL_S)
        except subprocess.TimeoutExpired:
            if is_stopping():
                process.terminate()
                process.communicate()
                raise StoppedError("stopped") from None


def _set(settings: list[str]) -> list[str]:
    return [part for setting in settings for part in ("--set", setting)]
