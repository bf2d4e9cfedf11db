"""Tests the dashboard in a real Chromium over fake services: what a user sees and does.

`HELIOS_TEST_SCREENSHOTS=DIR` keeps pictures of the page in light, dark and on a tablet.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from helios_client.commands.api_keys import add_key
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.topics import DECISION, ROBOT_DESCRIPTION
from playwright.sync_api import Browser, Page, expect

from tests.browser import DEADLINE_MS
from tests.gateway_home import description
from tests.gateway_process import Served, served
from tests.support import wait_until

INSTRUCTION = "Move the mug from the coffee table to the kitchen counter"
SCORES = "score over 5 views: first 0.25, now 0.82"
SIZES = {"light": (1600, 1150), "dark": (1600, 1150), "tablet": (820, 1180)}

expect.set_options(timeout=DEADLINE_MS)


@pytest.fixture
def gateway() -> Iterator[Served]:
    with served() as gateway:
        gateway.backend.publish_observation(gateway.backend.publish_frame())
        yield gateway


@pytest.fixture
def page(browser: Browser, gateway: Served) -> Iterator[Page]:
    faults: list[str] = []
    page = opened(browser, gateway.url, faults)
    yield page
    assert faults == []
    page.close()


def opened(browser: Browser, url: str, faults: list[str], **options: Any) -> Page:
    """The page after its first message of the robot. Script errors are appended to `faults`."""
    page = browser.new_page(**options)
    page.set_default_timeout(DEADLINE_MS)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(url)
    expect(page.locator("#ready")).not_to_have_text("connecting")
    return page


def submit(page: Page) -> None:
    page.fill("#instruction", INSTRUCTION)
    page.press("#instruction", "Enter")
    expect(page.locator("#task-state")).to_have_text("queued")


def phases(page: Page) -> list[str | None]:
    return [li.get_attribute("data-state") for li in page.locator("#phases li").all()]


def test_a_task_is_submitted_and_watched_until_it_succeeds(page: Page, gateway: Served) -> None:
    submit(page)
    gateway.backend.change_task(
        "t1", "running", phase="pick", message="drives to the mug", seeking="mug", progress=0.4
    )
    expect(page.locator("#task-message")).to_have_text("drives to the mug")
    assert phases(page) == ["done", "active", "waiting", "waiting"]
    gateway.backend.decide()
    expect(page.locator("#why-table tr.chosen")).to_contain_text("coffee table 2")
    expect(page.locator("#why-table tbody tr")).to_have_count(4)
    gateway.backend.change_task("t1", "succeeded", message="the mug is on the kitchen counter")
    expect(page.locator("#task-state")).to_have_text("succeeded")
    assert phases(page) == ["done"] * 4
    expect(page.locator("#cancel")).to_be_hidden()


def test_the_terms_of_a_decision_are_explained_and_shown_once(page: Page, gateway: Served) -> None:
    submit(page)
    terms = {"class_score": 0.6, "score": 0.5, "in_place": 1.0, "total": 0.5}
    mug = pb.Candidate(kind="object", name="mug", terms=terms, chosen=True)
    made = pb.Decision(task_id="t1", index=0, rule="pick (eq. 7, 11)", candidates=[mug])
    gateway.backend.bus.publish(DECISION, made)
    heads = page.locator("#why-table th")
    expect(heads).to_have_text(["candidate", "class score", "in place", "score"])
    expect(heads.nth(2)).to_have_attribute("title", re.compile("where the task says that it is"))
    made.index, made.candidates[0].terms["total"] = 1, 0.3
    gateway.backend.bus.publish(DECISION, made)
    expect(heads).to_have_text(["candidate", "class score", "in place", "score", "total"])


def test_an_instruction_that_is_not_understood_shows_an_error_beside_the_input(page: Page) -> None:
    page.fill("#instruction", "dance")
    page.click("text=Submit task")
    expect(page.locator("#ask-error")).to_contain_text("names no action")
    expect(page.locator("#instruction")).to_have_value("dance")


def test_a_suggestion_fills_the_instruction_field(page: Page) -> None:
    page.locator("#suggestions button").first.click()
    assert page.input_value("#instruction").startswith("Move the mug")


def shown_suggestions(page: Page) -> list[str]:
    return page.locator("#suggestions button").all_text_contents()


def test_suggestions_fit_the_detector_vocabulary_and_the_robots_abilities(
    page: Page, gateway: Served
) -> None:
    expect(page.locator("#suggestions button").first).to_have_text(INSTRUCTION)
    assert shown_suggestions(page)[1:] == ["Find the mug", "Go to the coffee table"]
    vocabulary = {"open": False, "names": ["table", "box", "shelf"], "detector": "", "scorer": ""}
    page.route("**/v1/vocabulary", lambda route: route.fulfill(json=vocabulary))
    page.reload()
    expect(page.locator("#seen-prompt")).to_have_attribute("placeholder", "table")
    armless = description()
    armless.can_pick = False
    gateway.backend.bus.publish(ROBOT_DESCRIPTION, armless)  # takes effect without a reload
    expect(page.locator("#suggestions button").first).to_have_text("Find the mug")


def test_a_task_is_cancelled(page: Page, gateway: Served) -> None:
    submit(page)
    page.click("#cancel")
    expect(page.locator("#task-state")).to_have_text("cancelled")
    assert gateway.backend.tasks["t1"].state == "cancelled"


def test_a_task_is_paused_and_resumed(page: Page, gateway: Served) -> None:
    submit(page)
    page.click("#pause")
    expect(page.locator("#pause")).to_have_text("Resume")
    expect(page.locator("#task-state")).to_have_text("queued")
    page.click("#pause")
    expect(page.locator("#pause")).to_have_text("Pause")
    gateway.backend.change_task("t1", "running", phase="pick")
    expect(page.locator("#task-state")).to_have_text("running")
    page.click("#pause")
    expect(page.locator("#task-state")).to_have_text("paused")
    expect(page.locator("#pause")).to_have_text("Resume")
    page.click("#pause")
    expect(page.locator("#task-state")).to_have_text("running")


def test_the_page_shows_a_service_that_dies(page: Page, gateway: Served) -> None:
    expect(page.locator("#ready")).to_have_text("ready")
    gateway.backend.die("detector")
    expect(page.locator("#ready")).to_have_text("not ready")
    expect(page.locator("#trouble")).to_contain_text("detector is down")
    expect(page.locator('#services [data-name="detector"]')).to_contain_text("down")
    gateway.backend.alive("detector", 5000)
    expect(page.locator("#trouble")).to_be_hidden()


def test_the_page_shows_a_lost_connection_and_reconnects(browser: Browser) -> None:
    with served() as first:
        page = opened(browser, first.url, [])
        submit(page)
    expect(page.locator("#lost")).to_be_visible()
    first.backend.change_task("t1", "succeeded")
    with served(port=first.port, backend=first.backend):
        expect(page.locator("#lost")).to_be_hidden()
        expect(page.locator("#task-state")).to_have_text("succeeded")
    page.close()


def test_the_page_tells_its_readiness_again_after_a_short_loss(
    browser: Browser, gateway: Served
) -> None:
    """After a short loss the gateway sends only what changed meanwhile."""
    page = browser.new_page()
    page.add_init_script(
        "window.streams = []; const Stream = window.EventSource;"
        "window.EventSource = class extends Stream {"
        "  constructor(...args) { super(...args); window.streams.push(this); } };"
        "window.EventSource.CLOSED = Stream.CLOSED;"
    )
    page.goto(gateway.url)
    expect(page.locator("#ready")).to_have_text("ready")
    for event, shown in (("error", "connection lost"), ("open", "ready")):
        page.evaluate(f"window.streams[0].dispatchEvent(new Event('{event}'))")
        expect(page.locator("#ready")).to_have_text(shown)
    page.close()


def test_stop_now_stays_in_view_latches_and_can_be_cleared(page: Page, gateway: Served) -> None:
    page.set_viewport_size({"width": 420, "height": 700})
    page.mouse.wheel(0, 5000)
    expect(page.locator("#stop")).to_be_in_viewport()
    page.click("#stop")
    expect(page.locator("#stopped")).to_be_visible()
    expect(page.locator("#ready")).to_have_text("stopped")
    assert gateway.backend.stopped
    page.click("#clear-stop")
    expect(page.locator("#stopped")).to_be_hidden()
    assert not gateway.backend.stopped


def test_an_object_shows_its_views_and_scores(page: Page) -> None:
    page.locator("#objects button", has_text="coffee table").click()
    panel = page.locator("#object")
    expect(panel).to_contain_text("coffee table 2")
    for words in ("score Ψ", "0.82", "views", "12", "detected in", "80 %"):
        expect(panel).to_contain_text(words)
    expect(panel.locator("meter").first).to_be_visible()
    expect(panel.locator("#object-views img").first).to_be_visible()
    expect(panel.locator("#object-view")).to_have_attribute(
        "alt", "what is modelled of coffee table 2"
    )
    expect(panel.locator("#object-history")).to_have_attribute("aria-label", SCORES)
    page.click("#object-close")
    expect(panel).to_be_hidden()


def test_the_map_shows_layers_zooms_and_pans(page: Page) -> None:
    expect(page.locator("#map-empty")).to_be_hidden()
    before = page.locator("#map").screenshot()
    page.click("text=Value: pick")
    expect(page.locator("#scale")).to_be_visible()
    page.wait_for_function("document.querySelector('#scale-max').textContent !== ''")
    valued = page.locator("#map").screenshot()
    page.focus("#map")
    for key in ("+", "+", "ArrowLeft"):
        page.keyboard.press(key)
    page.uncheck("#show-objects")
    page.wait_for_function("new Promise((done) => requestAnimationFrame(() => done(true)))")
    moved = page.locator("#map").screenshot()
    assert len({before, valued, moved}) == 3


def test_the_camera_shows_detections(page: Page) -> None:
    expect(page.locator("#camera")).to_be_visible()
    with page.expect_response(lambda r: "camera.jpg?raw=1" in r.url) as raw:
        page.uncheck("#boxes")
    assert raw.value.ok


def test_the_page_asks_for_a_key_and_keeps_it(browser: Browser, tmp_path: Path) -> None:
    key = add_key(tmp_path / "keys.toml", "tablet", "robot")
    with served("--keys", str(tmp_path / "keys.toml")) as gateway:
        page = browser.new_page()
        page.goto(gateway.url)
        expect(page.locator("#login")).to_be_visible()
        page.fill("#login-key", "a guess")
        page.click("#login button")
        expect(page.locator("#login-error")).to_contain_text("not known")
        page.fill("#login-key", key)
        page.click("#login button")
        expect(page.locator("#ready")).to_have_text("ready")
        submit(page)
        expect(page.locator("#change-key")).to_be_hidden()
        page.close()


def test_a_key_that_may_not_do_something_can_be_changed(browser: Browser, tmp_path: Path) -> None:
    reads, drives = (add_key(tmp_path / "keys.toml", n, n) for n in ("read", "robot"))
    with served("--keys", str(tmp_path / "keys.toml")) as gateway:
        page = browser.new_page()
        page.goto(gateway.url)
        page.fill("#login-key", reads)
        page.click("#login button")
        expect(page.locator("#ready")).to_have_text("ready")
        page.fill("#instruction", INSTRUCTION)
        page.get_by_role("button", name="Submit task").click()
        expect(page.locator("#ask-error")).to_contain_text("scope")
        page.click("#change-key")
        page.fill("#login-key", drives)
        page.click("#login button")
        expect(page.locator("#login")).to_be_hidden()
        submit(page)
        page.close()


def test_a_task_has_a_priority_and_limits(page: Page, gateway: Served) -> None:
    page.click(".options summary")
    page.select_option("#ask-priority", "10")
    page.fill("#ask-limit", "2.5")
    page.fill("#ask-steps", "300")
    submit(page)
    task = gateway.backend.tasks["t1"]
    assert (task.priority, task.max_steps) == (10, 300)
    expect(page.locator("#task-facts")).to_contain_text("priority")


def test_a_search_of_past_views_shows_images_and_marks_places_on_the_map(
    page: Page, gateway: Served
) -> None:
    page.fill("#seen-prompt", "the red mug")
    page.press("#seen-prompt", "Enter")
    expect(page.locator("#sights li")).to_have_count(5)
    expect(page.locator("#sights")).to_contain_text("in the map, score Ψ 0.71")
    expect(page.locator("#sights img").first).to_be_visible()
    before = page.locator("#map").screenshot()
    page.locator("#sights button", has_text="fits 0.82").click()
    wait_until(lambda: page.locator("#map").screenshot() != before, 60, "the map points at it")
    gateway.backend.recalls = Unavailable("no view has been kept")
    page.fill("#seen-prompt", "piano")
    page.click("#seen button")
    expect(page.locator("#seen-said")).to_contain_text("no object named in “piano”")
    expect(page.locator("#seen-said")).to_contain_text("no view has been kept")


@pytest.mark.parametrize("kind", SIZES)
def test_the_page_is_accessible(
    kind: str, browser: Browser, gateway: Served, tmp_path: Path
) -> None:
    """axe finds no violation of WCAG 2.1 A and AA while a task, a decision and an object show."""
    width, height = SIZES[kind]
    page = opened(
        browser,
        gateway.url,
        [],
        viewport={"width": width, "height": height},
        has_touch=kind == "tablet",
        color_scheme="dark" if kind == "dark" else "light",
        reduced_motion="reduce",
    )
    submit(page)
    gateway.backend.change_task(
        "t1",
        "running",
        phase="find_object",
        seeking="mug",
        steps=37,
        message="drives to where the coffee table shows",
        progress=0.35,
    )
    gateway.backend.decide()
    gateway.backend.publish_plan()
    page.click("text=Value: pick")
    page.locator("#objects button", has_text="mug").first.click()
    expect(page.locator("#why-table")).to_be_visible()
    expect(page.locator("#camera")).to_be_visible()
    wait_until(lambda: page.locator("#map-empty").is_hidden(), 60, "the map shows")
    folder = Path(os.environ.get("HELIOS_TEST_SCREENSHOTS") or tmp_path)
    folder.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=folder / f"dashboard-{kind}.png")
    wide = page.evaluate("document.documentElement.scrollWidth > innerWidth")
    assert not wide, "the page must be moved sideways"
    options = {"runOnly": {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}}
    found = Axe().run(page, options=options)
    assert found.violations_count == 0, found.generate_report()
    page.close()
