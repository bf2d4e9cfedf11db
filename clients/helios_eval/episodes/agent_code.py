"""Code of the agents of other packages: a digest tells whether it has changed since a run began.

Records name such an agent by its name alone, and the commit does not cover its files.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

from helios_core import plugins
from helios_planner.agents import AGENTS, agent_named

from helios_eval.episodes.episode_spec import WALKER

_DIGITS = 16  # hex digits


def agent_code(agents: Iterable[str]) -> dict[str, str]:
    """Digests of the Python files of the agents' packages, by `name_of` the agent; 16 hex digits.

    Agents of HELIOS are left out. Raises InvalidInput for an agent that cannot be loaded.
    """
    digests: dict[str, str] = {}
    for agent in agents:
        if agent in AGENTS or agent == WALKER:
            continue
        agent_named(agent)  # imports it
        named = plugins.find(plugins.AGENTS, agent)
        assert named is not None, "it was imported"
        package = sys.modules[named.module.partition(".")[0]]
        digests[name_of(agent)] = _digest(_files_of(package))
    return digests


def name_of(agent: str) -> str:
    """Key of an agent's code, as "agent NAME"."""
    return f"agent {agent}"


def _files_of(package: ModuleType) -> list[tuple[str, Path]]:
    """Python files of a package with their names in it, or the file of a single module."""
    folders = [Path(folder) for folder in getattr(package, "__path__", ())]
    if not folders:
        return [(package.__name__, Path(package.__file__ or ""))]
    return sorted((str(p.relative_to(f)), p) for f in folders for p in f.rglob("*.py"))


def _digest(files: Iterable[tuple[str, Path]]) -> str:
    digest = hashlib.sha256()
    for name, path in files:
        digest.update(f"{name}\n".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:_DIGITS]
