"""A headless Chromium, driven by Selenium: for tests of pages, and for films of them."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

OPTIONS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--window-size=1200,800",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--force-device-scale-factor=1",
    "--force-color-profile=srgb", "--enable-unsafe-swiftshader",  # WebGL without a graphics card
)  # fmt: skip
_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


def programs() -> tuple[str, str] | None:
    """Where Chromium and its driver are, None where they are not installed."""
    chromium, chromedriver = next(filter(None, map(shutil.which, _NAMES)), None), shutil.which("chromedriver")
    return None if chromium is None or chromedriver is None else (chromium, chromedriver)


@contextmanager
def opened_browser(profile: Path, *, patience: float = 600.0) -> Iterator[Any]:
    """Selenium's driver of it, with a profile in an empty folder; both have to be installed.

    patience [s]: how long the driver's start, a page or a script is waited for.
    """
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    class Patient(Service):
        """The driver's program; left to itself Selenium gives up after half a minute of asking whether it listens."""

        listens = False

        def is_connectable(self) -> bool:
            """Also called at the end, until it no longer listens: there is nothing to wait for."""
            end = time.monotonic() + patience
            while not (answers := super().is_connectable()) and not self.listens and time.monotonic() < end:
                self.assert_process_still_running()
                time.sleep(0.01)
            self.listens = self.listens or answers
            return bool(answers)

    places = programs()
    assert places is not None
    options = webdriver.ChromeOptions()
    options.binary_location = places[0]
    for option in (*OPTIONS, f"--user-data-dir={profile}"):
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Patient(places[1]))
    try:
        driver.set_script_timeout(patience)
        driver.set_page_load_timeout(patience)
        yield driver
    finally:
        driver.quit()
