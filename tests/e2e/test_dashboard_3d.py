"""Tests the dashboard's 3D view of the Gaussians in a real Chromium that renders in software.

`HELIOS_TEST_SCREENSHOTS=DIR` keeps a screenshot.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from helios_client.commands.api_keys import add_key
from playwright.sync_api import Browser, Page, expect

from tests.browser import DEADLINE_MS, WEBGL, beside
from tests.gateway_process import served
from tests.support import wait_until

expect.set_options(timeout=DEADLINE_MS)


@pytest.mark.long
def test_the_3d_view_shows_gaussians_with_the_key_and_loads_only_from_the_gateway(
    browser: Browser, tmp_path: Path
) -> None:
    key = add_key(tmp_path / "keys.toml", "tablet", "read")
    hosts: set[str] = set()
    with (
        served("--keys", str(tmp_path / "keys.toml")) as gateway,
        beside(browser, *WEBGL) as drawing,
    ):
        page = drawing.new_page(viewport={"width": 1300, "height": 950})
        page.set_default_timeout(120_000)
        page.on("request", lambda request: hosts.add(urlsplit(request.url).netloc))
        page.goto(gateway.url)
        page.fill("#login-key", key)
        page.click("#login button")
        expect(page.locator("#ready")).to_have_text("ready")
        page.click("#show-3d")
        view = page.locator("#frame-3d")
        pictures: list[bytes] = []

        def another_is_drawn() -> bool:
            now = view.screenshot()
            return colourful_px(now) > 500 and now not in pictures and not pictures.append(now)

        for name in ("Class", "Uncertainty"):
            page.locator("#colors button", has_text=name).click()
            wait_until(another_is_drawn, 120, "Gaussians are drawn")
        folder = Path(os.environ.get("HELIOS_TEST_SCREENSHOTS") or tmp_path)
        folder.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=folder / "dashboard-3d.png")
        cameras = turn(page)
        gateway.backend.change_objects()  # makes a newer scene
        wait_until(lambda: camera_of(page) == cameras[-1], 120, "it is shown as it was turned")
        wait_until(lambda: colourful_px(view.screenshot()) > 500, 120, "Gaussians are drawn again")
        page.click("#show-2d")
        expect(page.locator("#map")).to_be_visible()
        assert hosts - {""} == {urlsplit(gateway.url).netloc}
        page.close()


CAMERA = re.compile("initialCameraPosition=[^&]*")


def camera_of(page: Page) -> str:
    """The camera position in the address of the scene on show."""
    found = CAMERA.search(page.locator("#view-3d").get_attribute("src") or "")
    return found[0] if found else ""


def turn(page: Page) -> list[str]:
    """Turn the view by hand; the camera positions that viser logs from then on."""
    said: list[str] = []
    page.on("console", lambda one: said.extend(CAMERA.findall(one.text)))
    box = page.locator("#frame-3d").bounding_box()  # stays when a newer scene comes
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 120, y, steps=4)
    page.mouse.up()
    wait_until(lambda: camera_of(page) not in ("", *said[-1:]) and said, 60, "the camera moved")
    return said


def colourful_px(png: bytes) -> int:
    """The number of pixels with a strong colour."""
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return int((np.ptp(image.astype(int), axis=2) > 90).sum())
