"""Test that the page of settings is complete."""

from __future__ import annotations

from scripts.page_of_settings import BLOCK


def test_the_page_has_every_setting_as_it_is_now() -> None:
    page = BLOCK.page.read_text()
    assert BLOCK.fresh(page) == page, f"run {BLOCK.script}"
