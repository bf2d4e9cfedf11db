"""What a report says of runs whose detections come from a real detector."""

from __future__ import annotations

from collections.abc import Sequence

from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.report.agent_groups import Arm

NO_SIMULATION = "none is simulated"
REAL_NOTICE = (
    "These episodes ran in the simulator of this project, with the detections of a real model in "
    "rendered images. No figure here may be held against one of the paper: homes, images, "
    "detector and the choice of tasks differ."
)


def all_real(records: Sequence[EpisodeRecord]) -> bool:
    """True if a real detector made the detections of all episodes."""
    return all(r.semantics == "detector" for r in records)


def detectors(arms: Sequence[Arm]) -> list[tuple[str, str]]:
    """Facts on real detectors and on the classes of the tasks; none without any."""
    facts = []
    if named := list(dict.fromkeys(a.detector for a in arms if a.detector)):
        facts.append(("detector", f"{', '.join(named)} (after @: first digits of its SHA-256)"))
    if any(a.task_classes for a in arms):
        classes = dict.fromkeys(a.task_classes or "every class" for a in arms)
        facts.append(("classes of the tasks", ", ".join(classes)))
    return facts
