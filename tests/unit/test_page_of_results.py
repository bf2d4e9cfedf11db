"""The pages of results show the figures of the committed runs, and none of an incomplete run."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scripts import page_of_results
from scripts.markdown_tables import Block


@pytest.mark.parametrize("block", page_of_results.BLOCKS, ids=lambda b: f"{b.page.stem}-{b.name}")
def test_the_pages_show_the_committed_runs(block: Block) -> None:
    page = block.page.read_text()
    assert block.fresh(page) == page, f"run python -m {block.script.removesuffix('.py')}"


def test_a_run_with_a_missing_episode_shows_no_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = page_of_results.arms("table-4")
    assert page_of_results.is_complete(whole)
    first, *rest = whole
    part = (replace(first, records=first.records[1:]), *rest)

    monkeypatch.setattr(page_of_results, "arms", lambda folder: part if folder == "table-4" else ())

    assert "Being played: 199 episodes so far" in page_of_results.tables()
    assert "| `helios-paper`" not in page_of_results.tables()
    assert page_of_results.relations() == page_of_results.NONE_COMPLETE
    assert page_of_results.differences() == page_of_results.NONE_COMPLETE
