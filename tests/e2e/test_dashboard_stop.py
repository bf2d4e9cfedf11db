"""Tests the dashboard's stop button and map when the gateway or a layer is unavailable."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from tests.browser import DEADLINE_MS
from tests.gateway_process import Served, served

expect.set_options(timeout=DEADLINE_MS)


@pytest.fixture
def gateway() -> Iterator[Served]:
    with served() as gateway:
        yield gateway


@pytest.fixture
def page(browser: Browser, gateway: Served) -> Iterator[Page]:
    page = browser.new_page()
    page.set_default_timeout(DEADLINE_MS)
    yield page
    page.close()


def test_a_stop_without_an_answer_shows_an_error_and_can_be_pressed_again(
    page: Page, gateway: Served
) -> None:
    page.goto(gateway.url)
    kept: list[Route] = []
    page.route("**/v1/robot/stop", lambda route: kept.append(route))  # never answered
    page.click("#stop")
    expect(page.locator("#stop")).to_have_text("Stopping…")
    expect(page.locator("#failed")).to_contain_text("not known whether the robot stops")
    expect(page.locator("#failed")).to_contain_text("no answer came within 3 s")
    expect(page.locator("#stop")).to_have_text("Stop now")
    page.unroute("**/v1/robot/stop")
    page.click("#stop")
    expect(page.locator("#stopped")).to_be_visible()
    expect(page.locator("#failed")).to_be_hidden()
    assert gateway.backend.stopped


def test_the_stop_button_works_when_the_main_script_fails_to_load(
    page: Page, gateway: Served
) -> None:
    page.route("**/static/main.js", lambda route: route.abort())
    page.goto(gateway.url)
    page.click("#stop")
    expect(page.locator("#stopped")).to_be_visible()
    assert gateway.backend.stopped


def test_the_map_falls_back_to_occupancy_when_its_layer_disappears(
    page: Page, gateway: Served
) -> None:
    page.goto(gateway.url)
    pick = page.locator("#layers button", has_text="pick")
    expect(page.locator("#map-facts")).to_contain_text("version 41")
    pick.click()
    expect(page.locator("#scale")).to_be_visible()

    def without_layers(route: Route) -> None:
        answer = route.fetch()
        route.fulfill(response=answer, json=answer.json() | {"layers": []})

    page.route("**/v1/map", without_layers)
    page.route("**/v1/map/cells.png?layer=*", lambda route: route.fulfill(status=404, json={}))
    gateway.backend.change_map()
    expect(page.locator("#map-facts")).to_contain_text("version 42")
    expect(page.locator("#layers button", has_text="Occupancy")).to_have_attribute(
        "aria-pressed", "true"
    )
    expect(page.locator("#scale")).to_be_hidden()


def test_a_map_that_was_reset_is_no_longer_shown(page: Page, gateway: Served) -> None:
    page.goto(gateway.url)
    expect(page.locator("#map-facts")).to_contain_text("version 41")
    page.route("**/v1/map", lambda route: route.fulfill(status=503, json={"detail": "no map yet"}))
    gateway.backend.change_map()
    expect(page.locator("#map-empty")).to_have_text("no map yet")
    expect(page.locator("#map-facts")).to_be_empty()


def test_the_page_retries_a_failed_map_request(page: Page, gateway: Served) -> None:
    page.route("**/v1/map/cells.png", lambda route: route.fulfill(status=504, json={}), times=1)
    page.goto(gateway.url)
    expect(page.locator("#map-facts")).to_contain_text("version 41")
