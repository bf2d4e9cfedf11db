"""The pages of results show the figures of the committed runs, and none of an incomplete run."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scripts import page_of_results
from scripts.markdown_tables import Block

TABLE_4 = next(run for run in page_of_results.EARLIER if run.folder == "table-4")


@pytest.mark.parametrize("block", page_of_results.BLOCKS, ids=lambda b: f"{b.page.stem}-{b.name}")
def test_the_pages_show_the_committed_runs(block: Block) -> None:
    page = block.page.read_text()
    assert block.fresh(page) == page, f"run python -m {block.script.removesuffix('.py')}"


def test_a_run_with_a_missing_episode_shows_no_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = page_of_results.arms("table-4")
    assert page_of_results.is_complete(TABLE_4)
    first, *rest = whole
    part = (replace(first, records=first.records[1:]), *rest)

    monkeypatch.setattr(page_of_results, "arms", lambda folder: part if folder == "table-4" else ())

    assert not page_of_results.is_complete(TABLE_4)
    shown = page_of_results.tables(page_of_results.EARLIER)
    assert "Being played: 199 episodes so far" in shown
    assert "| `helios-paper`" not in shown
    assert page_of_results.relations() == page_of_results.NONE_COMPLETE
    assert page_of_results.differences() == page_of_results.NONE_COMPLETE


def test_a_run_whose_second_agent_has_no_episode_is_not_complete(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first, *_ = page_of_results.arms("table-4")
    monkeypatch.setattr(page_of_results, "arms", lambda folder: (first,))
    assert not page_of_results.is_complete(TABLE_4)


def test_a_run_of_several_commands_is_not_complete_before_the_last_command() -> None:
    assert page_of_results.is_complete(TABLE_4)
    assert not page_of_results.is_complete(replace(TABLE_4, arms=3))


def test_tasks_whose_object_is_absent_are_not_in_the_means_and_differences() -> None:
    first, second, *_ = page_of_results.arms("table-4")
    plain = page_of_results.means([first]), page_of_results.among([first, second])
    mixed = [
        replace(arm, records=(*arm.records, arm.records[0].model_copy(update=update)))
        for arm, update in (
            (first, {"absent": True, "seed": 10**6, "success": True, "steps": 9999}),
            (second, {"absent": True, "seed": 10**6, "success": False, "steps": 1}),
        )
    ]
    assert (page_of_results.means(mixed[:1]), page_of_results.among(mixed)) == plain


def test_a_difference_between_scorers_names_both() -> None:
    first, *_ = page_of_results.arms("table-4")
    settings = (("detector.scorer", "simulated:itc-exact"),)
    exact = replace(first, settings=settings)
    assert f"`{exact.scorer}` − `{first.scorer}`" in page_of_results.beside([exact], [first])


@pytest.mark.parametrize("rule", ["ovmm", "physical"])
def test_ratios_of_table_1_are_of_the_agents_as_printed(rule: str) -> None:
    rows = [
        row
        for row in page_of_results.relations().splitlines()
        if "(Table 1)" in row and f"`{rule}`" in row
    ]
    assert len(rows) == 6
    assert all("3000–3199" in row for row in rows)


def test_ratios_of_table_1_are_of_earlier_agents_while_a_run_is_being_played(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = page_of_results.arms
    monkeypatch.setattr(
        page_of_results, "arms", lambda folder: () if "printed" in folder else whole(folder)
    )
    assert "3000–3199" not in page_of_results.relations()
    assert page_of_results.relations().count("(Table 1)") == 12
