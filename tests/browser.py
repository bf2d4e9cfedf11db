"""Start a real Chromium for page tests: an installed one, or what `HELIOS_TEST_CHROMIUM` names."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, BrowserType, sync_playwright

# Software rendering: WebGL works on any machine.
WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_NAMES = ("chromium", "chromium-browser", "google-chrome")
DEADLINE_MS = 30_000


def chromium_path() -> str | None:
    """Return `HELIOS_TEST_CHROMIUM`, else the path of an installed Chromium, else None."""
    named = os.environ.get("HELIOS_TEST_CHROMIUM")
    return named or next(filter(None, map(shutil.which, _NAMES)), None)


@contextmanager
def chromium(*more: str) -> Iterator[Browser]:
    """Start Chromium with the arguments `more`; skip the test where none is installed."""
    path = chromium_path()
    if path is None:
        pytest.skip("no Chromium: apt-get install chromium, or set HELIOS_TEST_CHROMIUM")
    with sync_playwright() as playwright, _launched(playwright.chromium, path, more) as browser:
        yield browser


@contextmanager
def beside(browser: Browser, *more: str) -> Iterator[Browser]:
    """Start a second browser with other arguments: Playwright runs only once per thread."""
    path = chromium_path()
    assert path is not None
    with _launched(browser.browser_type, path, more) as another:
        yield another


@contextmanager
def _launched(kind: BrowserType, path: str, more: tuple[str, ...]) -> Iterator[Browser]:
    arguments = ["--no-sandbox", *(more or ("--disable-gpu",))]
    browser = kind.launch(executable_path=path, args=arguments)
    try:
        yield browser
    finally:
        browser.close()
