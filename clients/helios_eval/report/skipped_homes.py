"""Homes that a run skips, since they have no task of the classes that its tasks may ask for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from helios_eval.episodes.episode_record import Setting
from helios_eval.episodes.episode_spec import TASK_CLASSES
from helios_eval.report.number_format import plural, ranges

# Key in `run.json`: preset and classes of the tasks -> seeds of homes without such a task.
WITHOUT_TASK = "without_task"


@dataclass
class SkippedHomes:
    """Skipped seeds of one request."""

    preset: str
    settings: Mapping[str, Setting]
    seed0: int
    episodes: int
    seeds: set[int] = field(default_factory=set)

    def add_known(self, run: Mapping[str, Any]) -> None:
        """Add the seeds of this request that `run.json` names."""
        key = without_task_key({"preset": self.preset, "settings": self.settings})
        asked = range(self.seed0, self.seed0 + self.episodes)
        self.seeds.update(s for s in run.get(WITHOUT_TASK, {}).get(key, ()) if s in asked)

    def sentence(self) -> str:
        """What was skipped, and how many homes are left."""
        left = plural(self.episodes - len(self.seeds), "home")
        which = f"seed{'s' * (len(self.seeds) != 1)} {ranges(sorted(self.seeds))}"
        return (
            f"{len(self.seeds)} of {plural(self.episodes, 'home')} have no task of the allowed "
            f"classes and were skipped ({which}); {left} left."
        )


def without_task_key(order: Mapping[str, Any]) -> str:
    """Key within WITHOUT_TASK of a request: its preset and the classes of its tasks."""
    return f"{order['preset']}|{order['settings'].get(TASK_CLASSES, '')}"


def skipped_by(order: Mapping[str, Any], run: Mapping[str, Any]) -> SkippedHomes:
    """Skipped homes of one request in `run.json`."""
    out = SkippedHomes(
        order["preset"], order["settings"], int(order["seed0"]), int(order["episodes"])
    )
    out.add_known(run)
    return out
