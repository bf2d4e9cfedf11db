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

from scripts.markdown_tables import DOCS, Block, code, table

SERVICES = {"planner": PlannerSettings, "objectmap": ObjectMapSettings}
OWN = "your own"  # heads the column of agents of other packages
SAYS = {  # what a setting decides, in a few words
    "planner.start_receptacle_first": "the object must lie on the named start receptacle",
    "planner.confirm_from_near": "second check in front of a candidate",
    "planner.pick_at_last": "share of the steps after which the likeliest object is picked",
    "planner.place_at_last": "share of the steps after which the likeliest goal is taken",
    "planner.rounds": "searches of the home for the object",
    "planner.rounds_held": "searches of the home for the goal",
    "planner.place_rule": "place: on a flat area, or above the highest point",
    "planner.gaze_aim": "aim of the head at a gaze point",
    "planner.view_contours": "contours of extra views",
    "planner.pooled_looks": "a look at one thing counts for all things beside it",
    "planner.most_gaze_points": "gaze points of a candidate in eq. 11 and 12, the nearest ones",
    "planner.gain_norm": "unit of the gain in eq. 10",
    "planner.goal_seen_before_pick": "a goal detected before the pick counts (`trusting`)",
    "objectmap.expected_label": "expected label Y\\* of a pixel",
    "objectmap.object_voxel_m": "voxels that join objects, m",
    "objectmap.carving": "Gaussians that views see through are removed",
    "objectmap.view_weights": "weight of a view as evidence",
    "planner.od_a": "detector threshold, start receptacle",
    "planner.od_g": "detector threshold, object",
    "planner.od_b": "detector threshold, goal receptacle",
    "planner.cs_a": "class score of a candidate start receptacle",
    "planner.cs_g": "class score of a candidate object",
    "planner.cs_b": "class score of a candidate goal receptacle",
    "planner.tau_g": "score from which the robot picks",
    "planner.tau_b": "score from which the robot places",
    "objectmap.evidence": "unit of evidence",
    "objectmap.named_from": "share of evidence from which a Gaussian has a class",
    "objectmap.core_from": "share of evidence from which a Gaussian is in the core of an instance",
    "objectmap.look_alikes": "names of look-alikes at an instance",
    "objectmap.furniture_above_m": "height above the floor from which pixels are furniture, m",
    "objectmap.image_text": "image-text scores of the views that show an instance",
    "objectmap.equal_masks": "class of a pixel in several masks of one size",
    "planner.hand_sides": "sides from which a picked object is looked at in the hand",
    "planner.absent_from": "probability from which the object is reported as not there",
    "planner.unnamed_picks": "unnamed things on the start receptacle that are picked for a look",
    "objectmap.joined_by": "touching Gaussians of furniture that form one instance",
    "planner.ask_also": "names that the detector is asked for beside the task's",
    "objectmap.receptacle_voxel_m": "voxels that join receptacles, m",
    "objectmap.size_agreement": "weight by the usual size of the class",
}

# Agents that act on each detection, and what they use of the rules when they pick and place.
TRUSTING = ("trusting", "homerobot-heuristic", "random-frontier", "vlfm", "vlfm-unfiltered")
THEIRS = ("rounds", "rounds_held", "place_rule")
NOT_THE_HEURISTICS = "goal_seen_before_pick"  # all others of them use it


def tables() -> str:
    """Two tables, of rules beyond the paper and of other values, with a column for each preset."""
    presets = distinct_presets()
    names = dict.fromkeys(name for preset in AGENT_SETTINGS.values() for name in preset)
    others = [name for name in names if name not in PRINTED_RULES]
    return "\n".join(
        [
            _legend(presets),
            "Rules that the paper does not have, or has otherwise:\n",
            _table(PRINTED_RULES, presets),
            "Other values that an agent has of its own; every other agent has Table 3 of the "
            "paper:\n",
            _table(dict.fromkeys(others), presets),
        ]
    )


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
    lines += [
        f"- Column *{OWN}* holds for agents of other packages.",
        f"- {', '.join(map(code, TRUSTING))} act on each detection, without a score. Of the first "
        f"table they use {', '.join(map(code, THEIRS))} alone when they pick and place, and all "
        f"but `homerobot-heuristic` {code(NOT_THE_HEURISTICS)}; – marks the others.\n",
    ]
    return "\n".join(lines)


def _table(names: Mapping[str, object], presets: Mapping[str, list[str]]) -> str:
    rows = []
    for name in names:
        service, _, field = name.partition(".")
        info = SERVICES[service].model_fields[field]
        default = info.get_default(call_default_factory=True)
        unused = name in PRINTED_RULES and field not in THEIRS
        values = [
            "–"
            if unused and head in TRUSTING
            else code(_text(settings_for(head).get(name, default)))
            for head in presets
        ]
        rows.append([SAYS[name], code(field), *values, code(_text(default))])
    return table(("rule", "setting", *map(code, presets), OWN), rows)


def _text(value: Value) -> str:
    return (
        str(value).lower()
        if isinstance(value, bool)
        else f"{value:g}"
        if isinstance(value, float)
        else str(value)
    )


BLOCK = Block(DOCS / "reference/agents.md", "agents", "python -m scripts.page_of_agents", tables)

if __name__ == "__main__":
    BLOCK.main()
