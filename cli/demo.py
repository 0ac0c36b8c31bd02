"""`hyrecro demo`: the whole line once - climb, sense, map, record - and a score of what came out."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cli.options import resolved, service_arguments
from cli.pipeline import Pipeline
from cli.playback import play_trajectory
from cli.report import RunReport, score_run
from shared.runtime.config import Config
from shared.runtime.exit_codes import Exit
from shared.runtime.logs import configure_logs
from shared.runtime.ports import free_endpoint
from shared.runtime.run_folder import run_folder, run_name
from shared.runtime.snapshots import state_folder
from shared.runtime.stop_signal import StopSignal

_SPEED_RADPS = 0.3
"""Where no speed is set: 100 commands for each of a climb's many short rows would take six minutes."""
_SETTLE_S = 1.5
"""After the last target the mapper finishes its last scan and publishes the map once more (1 Hz)."""


def run_demo(config_path: Path, overrides: list[str], *, is_json: bool) -> int:
    """Runs the demo; exit code 3 where messages or track were lost or a service was restarted, 130 after Ctrl-C."""
    configure_logs(verbosity=-1)
    config = resolved(config_path, overrides)
    endpoint = free_endpoint(config.bus.endpoint)
    if endpoint != config.bus.endpoint:
        _say(f"{config.bus.endpoint} is taken, this run uses {endpoint}")
    overrides = [*overrides, f"bus.endpoint={endpoint}", f"recorder.run={run_name(config.recorder)}"]
    overrides += [f"player.speed_radps={_SPEED_RADPS}"] if config.player.speed_radps is None else []
    config = resolved(config_path, overrides)
    folder = run_folder(config.recorder, config.recorder.run)
    with StopSignal() as stop:
        num_restarts = _run_pipeline(config, service_arguments(config_path, overrides), folder, stop.is_set)
    if num_restarts is None:
        _say(f"stopped; what was recorded is in {folder}")
        return stop.exit_code()
    _say("scoring the run against the truth ...")
    report = _write_results(folder, config, num_restarts)
    if is_json:
        print(json.dumps(report.figures, indent=2))
    else:
        _print_tables(report.figures, folder)
    num_failures = report.figures["lost_messages"] + report.figures["num_scans_lost_tracking"] + len(num_restarts)
    return Exit.PARTIAL if num_failures else Exit.FINE


def _run_pipeline(
    config: Config, arguments: list[str], folder: Path, is_stopping: Callable[[], bool]
) -> dict[str, int] | None:
    """Returns how often each service was restarted, if any was; None: the climb was not played to its end."""
    with contextlib.ExitStack() as stack:
        state = stack.enter_context(state_folder(None))
        arguments = [*arguments, "--set", f"state_directory={state}"]
        pipeline = stack.enter_context(Pipeline(config, arguments, logs_dir=folder / "logs"))
        pipeline.start(is_stopping, on_ready=lambda name: _say(f"{name} is ready"))
        if is_stopping():
            return None
        _say(f"climbing {config.player.trajectory.name}, recording {folder}/run.mcap")
        is_finished = play_trajectory(config, lambda: is_stopping() or pipeline.has_failed())
        pipeline.check()
        deadline = time.monotonic() + _SETTLE_S
        while is_finished and time.monotonic() < deadline and not is_stopping():
            time.sleep(0.05)
        pipeline.check()
        return pipeline.num_restarts if is_finished and not is_stopping() else None


def _write_results(folder: Path, config: Config, num_restarts: dict[str, int]) -> RunReport:
    from cli.pictures import draw_map
    from services.recorder.bag.recording import Recording
    from shared.cloud_files import write_pcd
    from shared.trajectory_files import write_tum

    report = score_run(Recording(folder / "run.mcap"), config)
    report.figures["restarts"] = num_restarts
    write_pcd(folder / "map.pcd", report.map_points_m)
    write_tum(folder / "trajectory.tum", report.estimated)
    write_tum(folder / "truth.tum", report.true)
    draw_map(folder / "map.png", report)
    (folder / "report.json").write_text(json.dumps(report.figures, indent=2) + "\n")
    return report


def _print_tables(figures: dict[str, Any], folder: Path) -> None:
    console = Console()
    channels = Table("key", "published", "recorded", "lost", "Hz", title="messages")
    for column in channels.columns[1:]:
        column.justify = "right"
    for key, counts in figures["channels"].items():
        published = "-" if counts["published"] is None else str(counts["published"])
        channels.add_row(key, published, str(counts["received"]), str(counts["lost"]), f"{counts['rate_hz']:.1f}")
    console.print(channels)
    scores = Table(show_header=False, title="score")
    for name, text in _score_rows(figures):
        scores.add_row(name, text)
    console.print(scores)
    files = " ".join(sorted(path.name for path in folder.iterdir() if path.is_file()))
    console.print(f"files in {folder}: {files}", soft_wrap=True, highlight=False)
    console.print(f"look at it:  hyrecro view {folder}/run.mcap", soft_wrap=True, highlight=False)


_PRIORS = {"legs": "leg odometry", "imu": "the IMU", "constant_velocity": "the trend of the last scans"}


def _score_rows(figures: dict[str, Any]) -> list[tuple[str, str]]:
    again, on_true = figures["with_other_prior"], figures["off_plane_points_true_poses"]
    beside = "" if on_true is None else f" (with the true poses {on_true})"
    return [
        ("motion predicted by", _PRIORS[figures["prior"]]),
        ("trajectory, ATE RMSE", f"{figures['ate_rmse_m'] * 1000:.2f} mm over {figures['num_poses']} scans"),
        ("trajectory, RPE RMSE", f"{figures['rpe_rmse_m'] * 1000:.2f} mm a scan"),
        ("map accuracy, mean", f"{figures['map_accuracy_mean_m'] * 1000:.2f} mm over {figures['map_points']} points"),
        (
            "points off the planes",
            f"{figures['off_plane_points']}{beside}",
        ),
        ("time a scan, median", f"{figures['ms_per_scan_p50']:.1f} ms (95 %: {figures['ms_per_scan_p95']:.1f} ms)"),
        ("messages lost", str(figures["lost_messages"])),
        ("restarts", ", ".join(f"{name} {num}" for name, num in figures["restarts"].items()) or "none"),
        ("scans without tracking", str(figures["num_scans_lost_tracking"])),
        (
            f"again, predicted by {_PRIORS[again['prior']]}",
            f"ATE {again['ate_rmse_m'] * 1000:.2f} mm, RPE {again['rpe_rmse_m'] * 1000:.2f} mm, "
            f"{again['num_scans_lost_tracking']} scans lost",
        ),
    ]


def _say(text: str) -> None:
    print(text, file=sys.stderr)
