"""Tests driving by hand in a real Chromium: a held control moves the robot, a release stops it."""

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
from playwright.sync_api import Browser, Page, WebSocket, expect

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
    """Wait until the last keyframe is taken and no move follows."""
    wait_until(lambda: gateway.backend.driving.kinds()[-1:] == ["observe"], 60, "the robot stands")


def test_a_button_drives_while_it_is_held(page: Page, gateway: Served) -> None:
    driving = gateway.backend.driving
    page.get_by_label(AHEAD).hover()
    page.mouse.down()
    wait_until(lambda: driving.x_m > 0.15, 60, "the robot drives")
    expect(page.locator("#drive-said")).to_have_text("Drives.")
    page.mouse.up()
    stands(gateway)
    expect(page.locator("#drive-said")).to_be_empty()
    page.get_by_label("Turn right").hover()
    page.mouse.down()
    wait_until(lambda: driving.yaw_rad < 0, 60, "it turns to the right")
    page.mouse.move(5, 5)  # the pointer slides off the button, which stays held until released
    page.mouse.up()
    stands(gateway)


@pytest.mark.parametrize(("key", "kind"), [("w", "forward"), ("ArrowLeft", "turn"), ("D", "turn")])
def test_a_key_drives_while_it_is_held(page: Page, gateway: Served, key: str, kind: str) -> None:
    page.focus("#pad")
    page.keyboard.down(key)
    wait_until(lambda: gateway.backend.driving.kinds().count(kind) >= 2, 60, "it moves on")
    page.keyboard.up(key)
    stands(gateway)


def test_a_key_that_is_released_under_the_command_key_lets_go(page: Page, gateway: Served) -> None:
    """macOS sends no keyup of a letter while Cmd is down."""
    page.focus("#pad")
    page.keyboard.down("w")
    wait_until(lambda: gateway.backend.driving.moves, 60, "the robot drives")
    page.keyboard.down("Meta")
    stands(gateway)
    page.keyboard.up("Meta")
    page.keyboard.up("w")


@pytest.mark.parametrize(
    "let_go",
    [
        "window.dispatchEvent(new Event('blur'))",
        "document.querySelector('#map').focus()",
        "Object.defineProperty(document, 'hidden', {value: true});"
        "document.dispatchEvent(new Event('visibilitychange'))",
    ],
    ids=["blur", "focus", "hidden"],
)
def test_the_robot_stops_when_the_page_loses_the_focus(
    page: Page, gateway: Served, let_go: str
) -> None:
    page.focus("#pad")
    page.keyboard.down("w")
    wait_until(lambda: gateway.backend.driving.moves, 60, "the robot drives")
    page.evaluate(let_go)
    stands(gateway)


def test_the_robot_stops_when_the_page_is_closed(browser: Browser, gateway: Served) -> None:
    page = browser.new_page()
    page.goto(gateway.url)
    expect(page.get_by_label(AHEAD)).to_be_enabled()
    page.get_by_label(AHEAD).hover()
    page.mouse.down()
    wait_until(lambda: gateway.backend.driving.moves, 60, "the robot drives")
    page.close()
    stands(gateway)


def turns_only(page: Page, gateway: Served) -> None:
    """Turn by the pad; nothing that was pressed before may have driven ahead."""
    page.focus("#pad")
    page.keyboard.down("ArrowLeft")
    wait_until(lambda: gateway.backend.driving.moves, 60, "it turns")
    page.keyboard.up("ArrowLeft")
    assert "forward" not in gateway.backend.driving.kinds()


def test_the_drive_keys_do_nothing_elsewhere_on_the_page(page: Page, gateway: Served) -> None:
    sockets: list[WebSocket] = []
    page.on("websocket", lambda socket: sockets.append(socket))
    page.focus("#instruction")
    page.keyboard.type("wasd")
    page.focus("#map")
    page.keyboard.down("ArrowUp")
    page.keyboard.up("ArrowUp")
    turns_only(page, gateway)
    assert len([s for s in sockets if "teleop" in s.url]) == 1


def test_the_robot_drives_while_a_button_is_touched(browser: Browser, gateway: Served) -> None:
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
    wait_until(lambda: gateway.backend.driving.x_m > 0.15, 60, "the robot drives")
    devtools.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    stands(gateway)
    page.close()


def test_the_page_shows_the_reason_when_the_robot_is_blocked(page: Page, gateway: Served) -> None:
    gateway.backend.driving.blocked = "blocked after 0.02 m; look, and go another way"
    page.get_by_label(AHEAD).hover()
    page.mouse.down()
    expect(page.locator("#drive-said")).to_have_text(gateway.backend.driving.blocked)
    page.mouse.up()


def test_driving_is_disabled_while_a_task_runs(page: Page, gateway: Served) -> None:
    gateway.backend.submit(INSTRUCTION)
    gateway.backend.change_task("t1", "running")
    expect(page.get_by_label(AHEAD)).to_be_disabled()
    expect(page.locator("#drive-said")).to_contain_text("Cancel it to drive by hand")
    page.focus("#pad")
    page.keyboard.down("w")
    page.keyboard.up("w")
    gateway.backend.change_task("t1", "cancelled")
    expect(page.get_by_label(AHEAD)).to_be_enabled()
    turns_only(page, gateway)


def test_a_stop_ends_driving_and_shows_the_reason(page: Page, gateway: Served) -> None:
    page.focus("#pad")
    page.keyboard.down("w")
    wait_until(lambda: gateway.backend.driving.moves, 60, "the robot drives")
    gateway.backend._latch(True, "child on the floor")
    expect(page.locator("#drive-said")).to_contain_text("child on the floor")
    expect(page.locator("#stopped")).to_contain_text("The robot is stopped (child on the floor)")
    page.keyboard.up("w")


def test_the_buttons_are_disabled_for_a_robot_without_motion(page: Page, gateway: Served) -> None:
    still = description()
    still.can_move = False
    gateway.backend.bus.publish(ROBOT_DESCRIPTION, still)
    expect(page.locator("#drive-said")).to_contain_text("offers no motion")
    expect(page.get_by_label(AHEAD)).to_be_disabled()


def test_driving_with_a_read_only_key_shows_an_error(browser: Browser, tmp_path: Path) -> None:
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
        expect(page.locator("#drive-said")).to_contain_text("needs one of scope robot")
        assert gateway.backend.driving.moves == []
        page.close()


def test_the_remaining_time_of_a_task_is_shown_where_it_is_known(
    page: Page, gateway: Served
) -> None:
    gateway.backend.submit(INSTRUCTION)
    gateway.backend.change_task("t1", "running")
    expect(page.locator("#task-state")).to_have_text("running")
    expect(page.locator("#task-facts")).not_to_contain_text("left")
    task = LOOPBACK.get(f"{gateway.url}/v1/tasks/t1").json() | {"eta_s": [20.2, 44.9]}
    event = f"event: task\ndata: {json.dumps(task)}\n\n"
    page.route(
        "**/v1/events", lambda route: route.fulfill(body=event, content_type="text/event-stream")
    )
    page.reload()
    expect(page.locator("#task-facts")).to_contain_text("about 20 to 45 s")


@pytest.mark.parametrize(("kind", "size"), [("dark", (1600, 1150)), ("tablet", (820, 1180))])
def test_the_drive_pad_is_accessible(
    kind: str, size: tuple[int, int], browser: Browser, gateway: Served, tmp_path: Path
) -> None:
    page = browser.new_page(
        viewport={"width": size[0], "height": size[1]},
        has_touch=kind == "tablet",
        color_scheme="dark" if kind == "dark" else "light",
        reduced_motion="reduce",
    )
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
