"""A headless Chromium on the teleop page, as a person would use it."""

from __future__ import annotations

import re
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Page, expect, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome")
SLOW_MS = 90_000
"""The 3D view is drawn without a graphics card, on a busy machine at less than a frame a second."""


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
        return port


@contextmanager
def chromium() -> Iterator[Browser]:
    path = next(filter(None, map(shutil.which, NAMES)), None)
    assert path is not None, f"a browser is needed, one of {', '.join(NAMES)}: see tools/system-libraries.sh"
    flags = ["--no-sandbox", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=flags)
        try:
            yield browser
        finally:
            browser.close()


def opened(browser: Browser, port: int, width: int = 720, height: int = 800) -> Page:
    """The page, connected and with numbers on it."""
    page = browser.new_page(viewport={"width": width, "height": height})
    page.set_default_timeout(SLOW_MS)
    page.goto(f"http://127.0.0.1:{port}?fixedDpr=0.25")  # few pixels: only the controls matter here
    shows(page, re.compile("You command|You watch"))
    shows(page, re.compile(r"q1 -?\d"))
    return page


def shows(page: Page, text: str | re.Pattern[str]) -> None:
    expect(page.get_by_text(text).first).to_be_visible(timeout=SLOW_MS)


def press(page: Page, name: str, nth: int = 0) -> None:
    page.get_by_role("button", name=name, exact=True).nth(nth).click()


def set_joint(page: Page, joint: int, text: str) -> None:
    """Types a value beside a joint's slider, 0..7, in degrees or millimetres."""
    box = page.locator(".mantine-NumberInput-input").nth(joint)
    box.fill(text)
    box.press("Enter")
