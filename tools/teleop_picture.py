"""Saves a picture of the page that drives the robot.

With `hyrecro up --teleop --set teleop.silence_s=60` running:
python -m tools.teleop_picture http://127.0.0.1:8080 docs/pictures/teleop.png --posture stride
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

_WIDE, _NARROW = (1400, 900), (420, 900)
_FLAGS = ("--no-sandbox", "--enable-unsafe-swiftshader")
_TIMEOUT_MS = 180_000
"""Without a graphics card the 3D view takes its time."""


def save(url: str, path: Path, size: tuple[int, int], posture: str, wait_s: float) -> None:
    """One picture, with the robot on its way to a posture."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=list(_FLAGS))
        page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        page.set_default_timeout(_TIMEOUT_MS)
        page.goto(url)
        page.get_by_text("You command").first.wait_for()
        _close_notices(page)
        if posture:
            page.get_by_role("button", name=posture, exact=True).click()
        page.wait_for_timeout(1000 * wait_s)
        page.screenshot(path=path, timeout=_TIMEOUT_MS)
        browser.close()


def _close_notices(page: Page) -> None:
    """That there is no graphics card is not the page's business."""
    page.wait_for_timeout(3000)
    notices = page.locator(".mantine-Notification-closeButton")
    for _ in range(notices.count()):
        notices.first.click()


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("url")
    parser.add_argument("path", type=Path)
    parser.add_argument("--narrow", type=Path, help="a picture as on a telephone, too")
    parser.add_argument("--posture", default="", help="where the robot shall be going")
    parser.add_argument("--wait-s", type=float, default=15.0)
    arguments = parser.parse_args()
    save(arguments.url, arguments.path, _WIDE, arguments.posture, arguments.wait_s)
    if arguments.narrow is not None:
        save(arguments.url, arguments.narrow, _NARROW, "", arguments.wait_s)


if __name__ == "__main__":
    main()
