"""Tests that the page of keys is complete, so that clients in any language can rely on it."""

from __future__ import annotations

from scripts.page_of_keys import BLOCK, tables


def test_the_page_lists_every_key_with_its_messages() -> None:
    page = BLOCK.page.read_text()
    missing = [row for row in tables().splitlines() if row not in page]
    assert not missing, f"run {BLOCK.script}"
    assert BLOCK.fresh(page) == page, f"run {BLOCK.script}"
