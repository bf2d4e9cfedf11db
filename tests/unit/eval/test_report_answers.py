"""Tests how the report answers the research questions of the runs."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.report import research_questions
from helios_eval.report.agent_groups import arms_of, plainest_arms
from helios_eval.report.report_model import Paragraph, Row, Table
from helios_eval.report.requested_episodes import seeds_asked
from synthetic_episodes import NOISE, episode

HOMES = 30
WON = {"find_object": True, "pick": True, "success": True, "place": True, "cause": ""}
LOST = {"find_object": True, "pick": False, "success": False, "place": False, "cause": "stuck"}


def wins(agent: str, of: int, homes: int = HOMES, **more: object) -> list[EpisodeRecord]:
    """Episodes with success in the first `of` homes and failure in the others."""
    return [episode(s, agent, **((WON if s < of else LOST) | more)) for s in range(homes)]


def order(agents: Sequence[str], episodes: int, **more: object) -> dict[str, object]:
    return {
        "benchmark": "ovmm",
        "agents": agents,
        "semantics": "noisy",
        "preset": "synthetic",
        "noise": NOISE.model_dump(),
        "settings": {},
        "seed0": 0,
        "episodes": episodes,
    } | more


def answered(
    records: list[EpisodeRecord], *orders: dict[str, object]
) -> tuple[dict[str, Table], str]:
    """The section's tables by title, and its text."""
    section = research_questions.section(arms_of(records, seeds_asked({"asked": list(orders)})))
    assert section is not None
    tables = {b.title: b for b in section.blocks if isinstance(b, Table)}
    return tables, " ".join(b.text for b in section.blocks if isinstance(b, Paragraph))


def row(table: Table, group: str, name: str) -> Row:
    (found,) = [r for r in table.rows if r.group.startswith(group) and r.cells[0].text == name]
    return found


def cell_texts(found: Row) -> list[str]:
    return [c.text for c in found.cells]


def test_the_primary_claim_has_its_difference_ratio_and_verdict() -> None:
    tables, words = answered([*wins("helios-paper", 20), *wins("trusting", 8)])
    found = row(tables["Paired differences"], "Primary claim", "SR")
    name, first, second, difference, interval, ratio, n, so = cell_texts(found)
    assert (name, first, second, difference) == ("SR", "66.7", "26.7", "+40.0")
    assert interval.startswith("[+")
    assert ratio.startswith("2.50 [")
    assert found.cells[5].note == "paper 1.78"
    assert (n, so) == ("30", "ahead")
    assert "Not run: Beyond the paper" in words
    assert "; The global search objective" in words


def test_an_agent_that_is_worse_is_reported_as_behind() -> None:
    tables, _ = answered([*wins("helios-paper", 8), *wins("no-global-objective", 20)])
    assert cell_texts(row(tables["Paired differences"], "The global", "SR"))[-1] == "behind"


def test_the_report_compares_agents_beyond_the_paper() -> None:
    tables, _ = answered([*wins("helios-paper", 8), *wins("helios", 20)])
    found = cell_texts(row(tables["Paired differences"], "Beyond the paper", "SR"))
    assert (found[1], found[2], found[-1]) == ("66.7", "26.7", "ahead")


def test_an_incomplete_run_is_marked_as_preliminary() -> None:
    tables, _ = answered(
        [*wins("helios-paper", 20), *wins("trusting", 8)], order(["helios-paper", "trusting"], 200)
    )
    found = row(tables["Paired differences"], "Primary claim", "SR")
    assert (found.cells[6].note, found.cells[7].text) == ("of 200 homes", "ahead, so far")


def test_a_complete_short_run_compared_with_a_long_one_is_not_preliminary() -> None:
    idea = {"planner.new": True}
    tables, _ = answered(
        [*wins("helios-paper", 20, 40), *wins("helios-paper", 29, settings=idea)],
        order(["helios-paper"], 200),
        order(["helios-paper"], HOMES, settings=idea),
    )
    (found,) = tables[IDEAS].rows
    assert cell_texts(found)[0] == "helios-paper · new=True"
    assert (cell_texts(found)[-2], found.cells[-2].note) == (str(HOMES), "")
    assert cell_texts(found)[-1] == "better: Pick, SR, partial"


IDEAS = "Ideas beyond the paper, against the paper's method"


def test_a_run_with_other_settings_does_not_answer_for_helios() -> None:
    new = {"planner.tau_g": 0.4}
    tables, said = answered([*wins("helios-paper", 20, settings=new), *wins("helios", 22)])
    assert not tables
    assert "HELIOS without settings of its own" in said
    assert "other settings: Beyond the paper" in said


def test_the_ideas_table_lists_only_variants_that_the_paper_does_not_have() -> None:
    swept, new = {"planner.tau_g": 0.3}, {"planner.tau_g": 0.4}
    tables, _ = answered(
        [
            *wins("helios-paper", 20),
            *wins("trusting", 8),
            *wins("helios", 22),
            *wins("helios-paper", 20, settings=swept),
            *wins("helios-paper", 20, settings=new),
            *wins("helios-paper", 20, settings={"max_steps": 100}),
        ]
    )
    assert [cell_texts(r)[0] for r in tables[IDEAS].rows] == ["helios", "helios-paper · tau_g=0.4"]


def test_the_primary_claim_is_also_tested_under_every_other_noise() -> None:
    louder = NOISE.model_copy(update={"level": 2.0})
    tables, _ = answered(
        [
            *wins("helios-paper", 20),
            *wins("trusting", 8),
            *wins("helios-paper", 12, noise=louder),
            *wins("trusting", 4, noise=louder),
        ]
    )
    assert cell_texts(row(tables["Paired differences"], "The same at noise ×2", "SR"))[3] == "+26.7"


@pytest.mark.parametrize(
    ("report_of", "changed"),
    [("noise ×2", {"level": 2.0}), ("correlation 0", {"correlation": 0.0})],
)
def test_a_run_with_only_another_noise_is_labelled_with_that_noise(
    report_of: str, changed: dict[str, float]
) -> None:
    other = NOISE.model_copy(update=changed)
    tables, _ = answered(
        [*wins("helios-paper", 20, noise=other), *wins("trusting", 8, noise=other)]
    )
    (group,) = {r.group for r in tables["Paired differences"].rows}
    assert group == f"Primary claim: HELIOS above the trusting agent, {report_of}"


def test_one_agent_alone_answers_no_question() -> None:
    assert research_questions.section(arms_of(wins("helios-paper", 3))) is None


def test_a_drawing_shows_every_agent_before_the_settings_of_one() -> None:
    records = [*wins("trusting", 1, 2), *wins("helios-paper", 1, 2)]
    for k in range(5):
        records += wins("helios-paper", 1, 2, settings={"planner.tau_g": k / 10})
    shown = plainest_arms(arms_of(records), 3)
    assert shown[0].label == "helios-paper"
    assert "trusting" in [arm.label for arm in shown]


def test_agents_with_the_same_settings_are_compared_even_if_one_also_ran_without() -> None:
    new = {"planner.tau_g": 0.4}
    tables, _ = answered(
        [
            *wins("helios-paper", 20, settings=new),
            *wins("trusting", 12, settings=new),
            *wins("trusting", 8),
        ]
    )
    assert cell_texts(row(tables["Paired differences"], "Primary claim", "SR"))[1:3] == [
        "66.7",
        "40.0",
    ]


def test_episodes_that_were_not_played_make_no_agent_faster() -> None:
    unplayed = LOST | {"cause": "system error", "structure_hash": "", "steps": 0, "collisions": 0}
    half = [
        episode(s, "helios", **(WON if s % 2 else unplayed), **({"steps": 700} if s % 2 else {}))
        for s in range(HOMES)
    ]
    tables, _ = answered([*wins("helios-paper", 20, steps=500), *half])
    (found,) = tables[IDEAS].rows
    assert found.cells[6].text == "+200.0"
