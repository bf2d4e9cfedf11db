"""What the commands of a folder asked for, so that a part of it is never taken for the whole."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from helios_eval.episodes.episode_record import Noise, Setting
from helios_eval.episodes.service_settings import that_change

KEYS = ("benchmark", "agents", "semantics", "preset", "noise", "settings", "seed0", "episodes")

# benchmark, agent, semantics, preset, noise, settings: of an arm
Identity = tuple[str, str, str, str, Noise | None, tuple[tuple[str, Setting], ...]]


def commands_of(run: Mapping[str, Any]) -> list[list[str] | str]:
    """What was given in a folder, oldest first; of another program's `run.json` as it is there."""
    return run.get("commands") or [c for c in [run.get("command")] if c]


def orders_of(run: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What was asked for in a folder, oldest first: of every command the values of `KEYS`; of
    another program's `run.json` nothing."""
    orders = run.get("asked") or [{k: run[k] for k in KEYS if k in run}]
    return [order for order in orders if all(key in order for key in KEYS)]


def seeds_asked(run: Mapping[str, Any]) -> dict[Identity, set[int]]:
    """Seeds by what they were to be played by; of several commands all of them.

    As in a record, a setting that the agent's house ran with anyway is none.
    """
    ran = run.get("ran_with", {})
    out: dict[Identity, set[int]] = {}
    for order in orders_of(run):
        noise = Noise(**order["noise"]) if order["noise"] else None
        first = int(order["seed0"])
        for agent in order["agents"]:
            found = (order["benchmark"], agent, order["semantics"], order["preset"])
            changed = that_change(agent, order["settings"], ran.get(agent))
            settings = tuple(sorted(changed.items()))
            seeds = range(first, first + int(order["episodes"]))
            out.setdefault((*found, noise, settings), set()).update(seeds)
    return out
