"""The page of agents shows what each agent runs with, and the paper's agents run as printed."""

from __future__ import annotations

import pytest
from helios_core.agent_presets import AGENT_NAMES, PRINTED_RULES, settings_for
from helios_objectmap.settings import ObjectMapSettings
from helios_planner.agents import AGENTS
from helios_planner.settings import Settings as PlannerSettings

from scripts.page_of_agents import BLOCK, distinct_presets

PAPERS = [name for name in AGENT_NAMES if name not in ("helios", "homerobot-heuristic")]


def test_the_page_of_agents_is_fresh() -> None:
    page = BLOCK.page.read_text()
    assert BLOCK.fresh(page) == page, f"run {BLOCK.script}"


def test_every_agent_stands_in_exactly_one_column() -> None:
    columns = [name for agents in distinct_presets().values() for name in agents]
    assert sorted(columns) == sorted(AGENT_NAMES) == sorted(AGENTS)


@pytest.mark.parametrize("agent", PAPERS)
def test_the_agents_of_the_paper_run_with_the_printed_rules(agent: str) -> None:
    assert settings_for(agent) == PRINTED_RULES


def test_every_printed_rule_differs_from_the_default_so_that_the_preset_turns_something_off() -> (
    None
):
    fields = {"planner": PlannerSettings.model_fields, "objectmap": ObjectMapSettings.model_fields}
    for name, printed in PRINTED_RULES.items():
        service, _, field = name.partition(".")
        assert fields[service][field].default != printed, name


def test_helios_keeps_every_rule_of_ours() -> None:
    assert not PRINTED_RULES.keys() & settings_for("helios").keys()
