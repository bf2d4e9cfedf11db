"""Agents that planner and object map were started for, compared with the agent of a task."""

from __future__ import annotations

import json

from helios_core import proto as pb
from helios_core.agent_presets import same_settings
from helios_core.topics import settings_method

OBJECT_MAP_SETTINGS = settings_method("objectmap")


def reported_agent(reply: pb.SettingsReply) -> str:
    """Agent that a service was started for, by its settings; empty if they name none."""
    try:
        return str(json.loads(reply.json)["agent"]["value"])
    except (ValueError, KeyError, TypeError):
        return ""


def started_for_another(agent: str, planner: str, object_map: str) -> str:
    """Error message if planner or object map run with the settings of another agent; empty if a
    task of the agent can run. planner, object_map: the agents that they were started for; empty if
    unknown."""
    started = {"planner": planner, "object map": object_map}
    others = {s: a for s, a in started.items() if a and not same_settings(agent, a)}
    if not others:
        return ""
    changed = " and ".join(f"the {s} was started for {a!r}" for s, a in others.items())
    both = set(started.values()) - {""}
    instead = f", or submit the task for agent {both.pop()!r}" if len(both) == 1 else ""
    return (
        f"agent {agent!r} needs other settings: {changed}; start the services with helios up "
        f"--agent {agent}{instead}"
    )
