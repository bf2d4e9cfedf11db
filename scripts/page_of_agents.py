"""Write the settings in which the agents differ into docs/reference/agents.md; `--check` exits 1 if
stale."""

from __future__ import annotations

from collections.abc import Mapping

from helios_core.agent_presets import (
    AGENT_NAMES,
    AGENT_SETTINGS,
    PRINTED_RULES,
    Value,
    settings_for,
)
from helios_objectmap.settings import ObjectMapSettings
from helios_planner.settings import Settings as PlannerSettings

from scripts.markdown_tables import DOCS, Block, code, plain, sentence, table

SERVICES = {"planner": PlannerSettings, "objectmap": ObjectMapSettings}
OWN = "your own agent"


def tables() -> str:
    """Two tables, of rules beyond the paper and of other values, with a column for each preset."""
    presets = distinct_presets()
    names = dict.fromkeys(name for preset in AGENT_SETTINGS.values() for name in preset)
    others = [name for name in names if name not in PRINTED_RULES]
    return "\n".join([
        _legend(presets),
        "Rules that the paper does not have, or has otherwise:\n",
        _table(PRINTED_RULES, presets),
        "Other values that an agent has of its own; every other agent has Table 3 of the paper:\n",
        _table(dict.fromkeys(others), presets),
    ])  # fmt: skip


def distinct_presets() -> dict[str, list[str]]:
    """Agents with equal settings, by the agent that heads their column."""
    heads: dict[str, list[str]] = {"helios-paper": [], "helios": []}
    for agent in AGENT_NAMES:
        head = next((h for h in heads if settings_for(h) == settings_for(agent)), agent)
        heads.setdefault(head, []).append(agent)
    return heads


def _legend(presets: Mapping[str, list[str]]) -> str:
    lines = [
        f"- Column `{head}` also holds for {', '.join(map(code, agents[1:]))}."
        for head, agents in presets.items()
        if len(agents) > 1
    ]
    return "\n".join([*lines, f"- Column *{OWN}* holds for an agent of another package.\n"])


def _table(names: Mapping[str, object], presets: Mapping[str, list[str]]) -> str:
    rows = []
    for name in names:
        service, _, field = name.partition(".")
        info = SERVICES[service].model_fields[field]
        default = info.get_default(call_default_factory=True)
        values = [_text(settings_for(head).get(name, default)) for head in presets]
        rows.append([
            code(name), *map(code, [*values, _text(default)]),
            plain(sentence(info.description or "")),
        ])  # fmt: skip
    return table(("setting", *map(code, presets), OWN, "meaning"), rows)


def _text(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(
        value, float
    ) else str(value)  # fmt: skip


BLOCK = Block(DOCS / "reference/agents.md", "agents", "python -m scripts.page_of_agents", tables)

if __name__ == "__main__":
    BLOCK.main()
