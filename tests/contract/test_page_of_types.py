"""Tests that the tables of the driver types on the documentation page match the dataclasses."""

from __future__ import annotations

from typing import get_args

from helios_core.robot import Action

from scripts.page_of_types import ACTIONS, BLOCK


def test_the_tables_match_the_dataclasses() -> None:
    page = BLOCK.page.read_text()
    assert BLOCK.fresh(page) == page, f"run {BLOCK.script}"


def test_every_action_has_a_row() -> None:
    assert set(ACTIONS) == set(get_args(Action))
