"""`hyrecro view`: of a live robot and of what was recorded of it, in the real Rerun viewer."""

import os
import re
import signal
import subprocess
import urllib.request

import numpy as np
import psutil
import pytest
from PIL import Image

from shared.runtime.exit_codes import Exit
from tests.support.processes import BIN, ROOT, free_endpoint, hyrecro_command, run, started, wait_until

pytestmark = pytest.mark.e2e

ORANGE = (255, 160, 20)


def num_pixels_like(path, colour, tolerance=45):
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)
    return int((np.abs(pixels - colour).max(axis=2) < tolerance).sum())


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A view that waits for its robot, then the robot: the picture, and the recording that was made meanwhile."""
    folder, endpoint = tmp_path_factory.mktemp("view"), free_endpoint()
    picture = folder / "live.png"
    waiting = hyrecro_command("view", "--live", "--screenshot", picture)
    with started(waiting, folder / "view", endpoint) as view:
        stderr = view.directory / "stderr.txt"
        wait_until(lambda: "waiting" in stderr.read_text(), "the view to say that it waits")
        view.process.send_signal(signal.SIGTSTP)  # Ctrl-Z, which is not heard
        with started(hyrecro_command("up"), folder / "up", endpoint) as pipeline:
            assert view.process.wait(120) == Exit.FINE, stderr.read_text()
            assert pipeline.stop(signal.SIGINT) == Exit.INTERRUPTED
    return picture, folder / "up" / "latest" / "run.mcap"


def test_a_live_robot_is_drawn(shown):
    picture, _ = shown
    assert num_pixels_like(picture, ORANGE) > 50, "the fixed foot in orange"
    assert len(np.unique(np.asarray(Image.open(picture).convert("RGB")).reshape(-1, 3), axis=0)) > 5000


def test_a_recording_is_drawn_at_the_time_asked_for(shown, tmp_path):
    _, recording = shown
    for time_s in (0, 3):
        result = run("hyrecro", "view", recording, "--time", str(time_s), "--screenshot", tmp_path / f"{time_s}.png")
        assert (result.returncode, result.stderr, result.stdout) == (Exit.FINE, "", "")
    assert num_pixels_like(tmp_path / "3.png", ORANGE) > 50
    first, later = (np.asarray(Image.open(tmp_path / f"{time_s}.png").convert("RGB")) for time_s in (0, 3))
    assert (first != later).any(axis=2).sum() > 5000, "scan and map have come"


def test_a_recording_without_its_end_is_shown_as_far_as_it_goes(shown, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(shown[1].read_bytes()[:-100_000])
    result = run("hyrecro", "view", cut, "--screenshot", tmp_path / "cut.png")
    assert result.returncode == Exit.PARTIAL
    assert "hyrecro bag recover" in result.stderr
    assert num_pixels_like(tmp_path / "cut.png", ORANGE) > 50


def test_the_page_is_on_loopback_and_ends_with_its_command(shown):
    port = free_endpoint().rpartition(":")[2]
    command = [*hyrecro_command("view", shown[1], "--web", "--port", port)]
    with subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True, cwd=ROOT) as process:
        url = re.search(r"http://\S+", process.stderr.readline())[0]
        assert url.startswith(f"http://127.0.0.1:{port}/")
        with urllib.request.urlopen(url) as page:
            assert b"Rerun" in page.read()
        (child,) = psutil.Process(process.pid).children()
        listening = [each.laddr for each in child.net_connections() if each.status == psutil.CONN_LISTEN]
        assert len(listening) == 2
        assert {address.ip for address in listening} == {"127.0.0.1"}
        taken = run("hyrecro", "view", shown[1], "--web", "--port", port)
        assert (taken.returncode, f"port {port} on 127.0.0.1 is taken" in taken.stderr) == (Exit.FAILED, True)
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == Exit.INTERRUPTED
    wait_until(lambda: not child.is_running(), "the end of the viewer")


def refused(*arguments, **environment):
    result = subprocess.run(
        [BIN / "hyrecro", "view", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=60,
        check=False,
        env={**os.environ, "DISPLAY": "", "WAYLAND_DISPLAY": "", **environment},
    )
    return result.returncode, result.stderr


def test_what_cannot_be_shown_is_said(shown, tmp_path):
    text = tmp_path / "notes.mcap"
    text.write_text("a text file")
    assert refused(text) == (Exit.USAGE, f"hyrecro: {text}: is no MCAP file\n")
    assert refused(shown[1]) == (
        Exit.FAILED,
        "hyrecro: there is no display for a window: give --web for a page, or --screenshot OUT.png\n",
    )
    without_driver = {"VK_DRIVER_FILES": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent"}
    code, said = refused(shown[1], "--screenshot", tmp_path / "x.png", **without_driver)
    assert (code, "mesa-vulkan-drivers" in said, len(said.splitlines())) == (Exit.FAILED, True, 1)
