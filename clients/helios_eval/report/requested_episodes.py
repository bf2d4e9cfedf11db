"""Episodes that the commands of a folder requested, so that a report can show missing ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from helios_eval.episodes.episode_record import Noise, Setting
from helios_eval.episodes.service_settings import differing_settings
from helios_eval.report.skipped_homes import skipped_by

KEYS = ("benchmark", "agents", "semantics", "preset", "noise", "settings", "seed0", "episodes")

# identity of an arm: benchmark, agent, semantics, preset, noise, settings
Identity = tuple[str, str, str, str, Noise | None, tuple[tuple[str, Setting], ...]]


def commands_of(run: Mapping[str, Any]) -> list[list[str] | str]:
    """Commands of a folder, oldest first.

    A `run.json` of another program has a single `command`, which is returned as it is.
    """
    return run.get("commands") or [c for c in [run.get("command")] if c]


def requests_of(run: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Requests of a folder's commands, oldest first, each with the values of `KEYS`.

    A `run.json` without these keys gives none.
    """
    orders = run.get("asked") or [{k: run[k] for k in KEYS if k in run}]
    return [order for order in orders if all(key in order for key in KEYS)]


def seeds_asked(run: Mapping[str, Any]) -> dict[Identity, set[int]]:
    """Requested seeds of all commands, by the identity of the arm.

    As in a record, a setting that equals that of the agent's stack is left out. So are homes that
    have no task of the request's classes.
    """
    ran = run.get("ran_with", {})
    out: dict[Identity, set[int]] = {}
    for order in requests_of(run):
        noise = Noise(**order["noise"]) if order["noise"] else None
        first = int(order["seed0"])
        for agent in order["agents"]:
            found = (order["benchmark"], agent, order["semantics"], order["preset"])
            changed = differing_settings(agent, order["settings"], ran.get(agent))
            settings = tuple(sorted(changed.items()))
            seeds = set(range(first, first + int(order["episodes"])))
            seeds -= skipped_by(order, run).seeds
            out.setdefault((*found, noise, settings), set()).update(seeds)
    return out
