"""Driving by hand in a real Chromium: what is held moves the robot, letting go stops it."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from helios_client.commands.api_keys import add_key
from helios_core.topics import ROBOT_DESCRIPTION
from playwright.sync_api import Browser, Page, expect

from tests.browser import DEADLINE_MS
from tests.gateway_home import description
from tests.gateway_process import Served, served
from tests.support import LOOPBACK, wait_until

INSTRUCTION = "move the mug to the kitchen counter"
AHEAD = "Drive ahead"

expect.set_options(timeout=DEADLINE_MS)


@pytest.fixture
def gateway() -> Iterator[Served]:
    with served() as gateway:
        yield gateway


@pytest.fixture
def page(browser: Browser, gateway: Served) -> Iterator[Page]:
    faults: list[str] = []
    page = browser.new_page()
    page.set_default_timeout(DEADLINE_MS)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(gateway.url)
    expect(page.get_by_label(AHEAD)).to_be_enabled()
    yield page
    assert faults == []
    page.close()


def stands(gateway: Served) -> None:
    """The last keyframe was taken, and no move follows."""
    wait_until(lambda: gateway.backend.driving.kinds()[-1:] == ["observe"], 30, "the robot stands")


def test_a_button_drives_while_it_is_held(page: Page, gateway: Served) -> None:
    driving = gateway.backend.driving
    page.get_by_label(AHEAD).hover()
    page.mouse.down()
    wait_until(lambda: driving.x_m > 0.15, 30, "the robot drives")
    expect(page.locator("#drive-said")).to_have_text("Drives.")
    page.mouse.up()
    stands(gateway)
    expect(page.locator("#drive-said")).to_be_empty()
    page.get_by_label("Turn right").hover()
    page.mouse.down()
    wait_until(lambda: driving.yaw_rad < 0, 30, "it turns to the right")
    page.mouse.move(5, 5)  # the hand slides off the button: what is held stays held until let go
    page.mouse.up()
    stands(gateway)


@pytest.mark.parametrize(("key", "kind"), [("w", "forward"), ("ArrowLeft", "turn"), ("D", "turn")])
def test_a_key_drives_while_it_is_held(page: Page, gateway: Served, key: str, kind: str) -> None:
    page.focus("#pad")
    page.keyboard.down(key)
    wait_until(lambda: gateway.backend.driving.kinds()[:2] == [kind] * 2, 30, "it moves on")
    page.keyboard.up(key)
    stands(gateway)


@pytest.mark.parametrize(
    "let_go", ["window.dispatchEvent(new Event('blur'))", "document.querySelector('#map').focus()"]
)
def test_a_page_that_loses_the_focus_lets_go(page: Page, gateway: Served, let_go: str) -> None:
    page.focus("#pad")
    page.keyboard.down("w")
    wait_until(lambda: gateway.backend.driving.moves, 30, "the robot drives")
    page.evaluate(let_go)
    stands(gateway)


def test_a_page_that_is_closed_lets_go(browser: Browser, gateway: Served) -> None:
    page = browser.new_page()
    page.goto(gateway.url)
    expect(page.get_by_label(AHEAD)).to_be_enabled()
    page.get_by_label(AHEAD).hover()
    page.mouse.down()
    wait_until(lambda: gateway.backend.driving.moves, 30, "the robot drives")
    page.close()
    stands(gateway)


def test_the_keys_drive_nothing_elsewhere_on_the_page(page: Page, gateway: Served) -> None:
    page.fill("#instruction", "wasd")
    page.focus("#map")
    page.keyboard.press("ArrowUp")
    assert gateway.backend.driving.moves == []


def test_a_touch_drives(browser: Browser, gateway: Served) -> None:
    page = browser.new_page(viewport={"width": 820, "height": 1180}, has_touch=True)
    page.set_default_timeout(DEADLINE_MS)
    page.goto(gateway.url)
    expect(page.get_by_label(AHEAD)).to_be_enabled()
    page.get_by_label(AHEAD).scroll_into_view_if_needed()
    box = page.get_by_label(AHEAD).bounding_box()
    assert box is not None
    point = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2}
    devtools = page.context.new_cdp_session(page)
    devtools.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [point]})
    wait_until(lambda: gateway.backend.driving.x_m > 0.15, 30, "the robot drives")
    devtools.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    stands(gateway)
    page.close()


def test_what_blocks_the_robot_is_said(page: Page, gateway: Served) -> None:
    gateway.backend.driving.blocked = "blocked after 0.02 m; look, and go another way"
    page.get_by_label(AHEAD).hover()
    page.mouse.down()
    expect(page.locator("#drive-said")).to_have_text(gateway.backend.driving.blocked)
    page.mouse.up()


def test_while_a_task_has_the_robot_nobody_drives(page: Page, gateway: Served) -> None:
    gateway.backend.submit(INSTRUCTION)
    gateway.backend.change_task("t1", "running")
    expect(page.get_by_label(AHEAD)).to_be_disabled()
    expect(page.locator("#drive-said")).to_contain_text("Cancel it to drive by hand")
    page.focus("#pad")
    page.keyboard.press("w")
    gateway.backend.change_task("t1", "cancelled")
    expect(page.get_by_label(AHEAD)).to_be_enabled()
    assert gateway.backend.driving.moves == []


def test_a_stop_ends_the_driving_and_says_why(page: Page, gateway: Served) -> None:
    page.focus("#pad")
    page.keyboard.down("w")
    wait_until(lambda: gateway.backend.driving.moves, 30, "the robot drives")
    gateway.backend._latch(True, "child on the floor")
    expect(page.locator("#drive-said")).to_contain_text("child on the floor")
    expect(page.locator("#stopped")).to_contain_text("The robot is stopped (child on the floor)")
    page.keyboard.up("w")


def test_a_robot_that_offers_no_motion_has_no_buttons_to_press(page: Page, gateway: Served) -> None:
    still = description()
    still.can_move = False
    gateway.backend.bus.publish(ROBOT_DESCRIPTION, still)
    expect(page.locator("#drive-said")).to_contain_text("offers no motion")
    expect(page.get_by_label(AHEAD)).to_be_disabled()


def test_a_key_that_may_only_look_is_told_so(browser: Browser, tmp_path: Path) -> None:
    look = add_key(tmp_path / "keys.toml", "wall", "read")
    with served("--keys", str(tmp_path / "keys.toml")) as gateway:
        page = browser.new_page()
        page.set_default_timeout(DEADLINE_MS)
        page.goto(gateway.url)
        page.fill("#login-key", look)
        page.click("#login button")
        expect(page.get_by_label(AHEAD)).to_be_enabled()
        page.focus("#pad")
        page.keyboard.press("w")
        expect(page.locator("#drive-said")).to_contain_text("needs one that may operate")
        assert gateway.backend.driving.moves == []
        page.close()


def test_how_long_a_task_may_still_take_is_shown_where_it_is_known(
    page: Page, gateway: Served
) -> None:
    gateway.backend.submit(INSTRUCTION)
    gateway.backend.change_task("t1", "running")
    expect(page.locator("#task-state")).to_have_text("running")
    expect(page.locator("#task-facts")).not_to_contain_text("left")
    task = LOOPBACK.get(f"{gateway.url}/v1/tasks/t1").json() | {"eta_s": [20.2, 44.9]}
    event = f"event: task\ndata: {json.dumps(task)}\n\n"
    page.route("**/v1/events", lambda route: route.fulfill(
        body=event, content_type="text/event-stream"
    ))  # fmt: skip
    page.reload()
    expect(page.locator("#task-facts")).to_contain_text("about 20 to 45 s")


@pytest.mark.parametrize(("kind", "size"), [("dark", (1600, 1150)), ("tablet", (820, 1180))])
def test_everybody_can_read_and_use_the_pad(
    kind: str, size: tuple[int, int], browser: Browser, gateway: Served, tmp_path: Path
) -> None:
    page = browser.new_page(
        viewport={"width": size[0], "height": size[1]}, has_touch=kind == "tablet",
        color_scheme="dark" if kind == "dark" else "light", reduced_motion="reduce",
    )  # fmt: skip
    page.set_default_timeout(DEADLINE_MS)
    page.goto(gateway.url)
    expect(page.get_by_label(AHEAD)).to_be_enabled()
    page.focus("#pad")
    page.keyboard.down("w")
    expect(page.get_by_label(AHEAD)).to_have_class(re.compile("held"))
    expect(page.locator("#drive-said")).to_have_text("Drives.")
    folder = Path(os.environ.get("HELIOS_TEST_SCREENSHOTS") or tmp_path)
    folder.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=folder / f"drive-{kind}.png")
    options = {"runOnly": {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}}
    found = Axe().run(page, options=options)
    assert found.violations_count == 0, found.generate_report()
    page.close()
