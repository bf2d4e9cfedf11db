"""Tests the page of all robots in a real Chromium over four fake robots.

`HELIOS_TEST_SCREENSHOTS=DIR` keeps pictures of the page: wide and on a phone, light and dark.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from helios_core import proto as pb
from helios_core.memory_bus import MemoryHub
from helios_core.topics import STOP
from playwright.sync_api import Browser, Locator, Page, expect

from tests.browser import DEADLINE_MS
from tests.gateway_backend import Backend
from tests.gateway_process import Served, served
from tests.support import wait_until

INSTRUCTION = "Move the mug from the coffee table to the kitchen counter"
NAMES = ("robot", "robot-2", "robot-3", "robot-4")
SIZES = {"wide": (1440, 1000), "phone": (390, 844)}

expect.set_options(timeout=DEADLINE_MS)


class Robots:
    """A gateway with four fake robots: one busy, one idle, one stopped, one away."""

    def __init__(self, gateway: Served, backends: dict[str, Backend]) -> None:
        self.url, self.backends = gateway.url, backends
        self.busy = backends["robot"]
        task = self.busy.submit(INSTRUCTION)
        self.busy.change_task(task.id, "running", progress=0.4, message="picks the mug", steps=31)
        backends["robot-2"].battery = 0.63
        backends["robot-2"].publish_robot()
        for number, backend in enumerate(backends.values()):
            backend.publish_frame(np.full((480, 640, 3), 60 + 40 * number, np.uint8))
        reason = pb.StopRequest(reason="the door is open")
        backends["robot-3"].bus.call(STOP, reason, 5)
        backends["robot-4"].die("bridge")


@pytest.fixture
def robots() -> Iterator[Robots]:
    hub = MemoryHub()
    backends = {name: Backend(hub, name) for name in NAMES}
    for backend in backends.values():
        backend.start()
    with served("--robots", ",".join(NAMES[1:]), backend=backends["robot"]) as gateway:
        yield Robots(gateway, backends)


@pytest.fixture
def page(browser: Browser, robots: Robots) -> Iterator[Page]:
    faults: list[str] = []
    page = browser.new_page()
    page.set_default_timeout(DEADLINE_MS)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(f"{robots.url}/fleet")
    expect(page.locator("#count")).to_have_text("1 idle · 1 busy · 1 stopped · 1 away")
    yield page
    assert faults == []
    page.close()


def card(page: Page, name: str) -> Locator:
    return page.locator("#robots > li").filter(has=page.get_by_role("link", name=name, exact=True))


def test_each_robot_has_a_card_with_state_task_battery_and_picture(page: Page) -> None:
    busy = card(page, "robot")
    expect(busy.locator(".pill")).to_have_text("busy")
    expect(busy).to_contain_text(INSTRUCTION)
    expect(busy).to_contain_text("picks the mug")
    expect(busy.get_by_role("progressbar")).to_have_attribute("aria-valuenow", "40")
    expect(card(page, "robot-2")).to_contain_text("63 %")
    expect(card(page, "robot-2").locator("img")).to_be_visible()
    expect(card(page, "robot-3")).to_contain_text("the door is open")
    expect(card(page, "robot-4").locator(".pill")).to_have_text("away")


def test_a_task_is_given_to_any_robot_and_cancelled(page: Page, robots: Robots) -> None:
    page.get_by_label("What shall a robot do?").fill(INSTRUCTION)
    page.get_by_label("What shall a robot do?").press("Enter")
    queue = page.locator("#queue > li")
    expect(queue).to_contain_text("robot-2's map had the mug")
    second = robots.backends["robot-2"]
    wait_until(lambda: len(second.tasks) == 1, 60, "the idle robot has it")
    queue.get_by_role("button", name="Cancel").click()
    expect(page.locator("#queue-empty")).to_be_visible()
    assert [task.state for task in second.tasks.values()] == ["cancelled"]
    page.get_by_label("What shall a robot do?").fill("dance")
    page.get_by_role("button", name="Submit task").click()
    expect(page.locator("#ask-error")).to_contain_text("names no action")


def test_stop_all_stops_every_robot_and_one_is_cleared_alone(page: Page, robots: Robots) -> None:
    page.get_by_role("button", name="Stop all").click()
    wait_until(lambda: all(b.stopped for b in robots.backends.values()), 60, "all are stopped")
    expect(card(page, "robot-2").locator(".pill")).to_have_text("stopped")
    page.get_by_role("button", name="Clear stop: robot-2", exact=True).click()
    expect(card(page, "robot-2").locator(".pill")).to_have_text("idle")
    assert robots.backends["robot"].stopped


def test_a_second_press_on_stop_keeps_the_robot_stopped(page: Page, robots: Robots) -> None:
    stop = page.get_by_role("button", name="Stop: robot-2", exact=True)
    place = stop.bounding_box()
    stop.click()
    expect(card(page, "robot-2").locator(".pill")).to_have_text("stopped")
    assert place is not None
    assert stop.bounding_box() == place
    with page.expect_response("**/robots/robot-2/robot/*") as answer:
        page.mouse.click(place["x"] + place["width"] / 2, place["y"] + place["height"] / 2)
    assert answer.value.url.endswith("/robot/stop")
    assert robots.backends["robot-2"].stopped


def test_every_robot_that_stop_all_does_not_reach_is_named_until_the_next_press(
    page: Page, robots: Robots
) -> None:
    away = ("robot", "robot-2")
    for name in away:
        page.route(
            f"**/v1/robots/{name}/robot/stop",
            lambda route: route.fulfill(status=503, json={"detail": "no bridge answers."}),
        )
    page.get_by_role("button", name="Stop all").click()
    for name in away:
        expect(page.locator("#failed")).to_contain_text(
            f"{name}: The stop did not get through: no bridge answers."
        )
    page.unroute_all()
    page.get_by_role("button", name="Stop: robot-2", exact=True).click()
    expect(page.locator("#failed")).to_be_hidden()
    wait_until(lambda: robots.backends["robot-2"].stopped, 60, "it is stopped")


def test_the_dashboard_leads_to_the_page_and_a_card_back(page: Page, robots: Robots) -> None:
    card(page, "robot-2").get_by_role("link", name="robot-2").click()
    expect(page.locator("#robots")).to_have_value("robot-2")
    page.get_by_role("link", name="Fleet").click()
    expect(page.locator("#robots > li")).to_have_count(4)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_fits_the_screen_and_is_accessible(
    browser: Browser, robots: Robots, size: str, scheme: str, tmp_path: Path
) -> None:
    width, height = SIZES[size]
    page = browser.new_page(
        viewport={"width": width, "height": height},
        color_scheme="dark" if scheme == "dark" else "light",
    )
    page.goto(f"{robots.url}/fleet")
    expect(card(page, "robot-4").locator(".pill")).to_have_text("away")
    expect(card(page, "robot").locator("img")).to_be_visible()
    folder = Path(os.environ.get("HELIOS_TEST_SCREENSHOTS") or tmp_path)
    folder.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=folder / f"fleet-{size}-{scheme}.png", full_page=size == "phone")
    assert not page.evaluate("document.documentElement.scrollWidth > innerWidth")
    options = {"runOnly": {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}}
    found = Axe().run(page, options=options)
    assert found.violations_count == 0, found.generate_report()
    page.close()
