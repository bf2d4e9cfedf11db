"""Judgement of detections on objects of a simulated home, counted by class and looks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from helios_core.name_rules import plain
from helios_core.types import Detection
from helios_detector.vocabulary_matching import accepted_names, neighbours

from helios_eval.studies.realism_views import Thing, View, iou

COVERS_IOU = 0.5
NOWHERE_IOU = 0.3  # a detection with less on every object is false
PARAMETRIC, REALISTIC = "parametric", "realistic"


@dataclass(frozen=True)
class Judgement:
    """Result of the detector for one object in one image."""

    looks: str  # parametric or realistic
    class_name: str
    found: str  # the detector's name for it; empty if no detection covers it
    score: float  # score of that detection
    recognised: bool


@dataclass(frozen=True)
class Row:
    """Counts of one class in one kind of looks."""

    seen: int
    recognised: int
    taken_for: tuple[tuple[str, int], ...]  # wrong names, most frequent first


@dataclass(frozen=True)
class Judged:
    """View with its detections and their judgement."""

    view: View
    looks: str
    detections: tuple[Detection, ...]
    sights: tuple[tuple[Thing, Judgement], ...]

    @property
    def of_nothing(self) -> int:
        """Number of detections that cover no object."""
        boxes = [t.box_xyxy for t in self.view.things]
        return sum(
            all(iou(d.box_xyxy, box) < NOWHERE_IOU for box in boxes) for d in self.detections
        )


def names_for(class_name: str, vocabulary: Iterable[str] | None) -> frozenset[str]:
    """Names of the detector that are correct for a simulator class; empty if it knows none.

    The class's own name and synonyms; wider or neighbouring kinds only if there are none.
    """
    if vocabulary is None:
        return frozenset({class_name})
    known = {plain(name): name for name in vocabulary}
    same = accepted_names(class_name) & known.keys()
    return frozenset(known[name] for name in same or (neighbours(class_name) & known.keys()))


def judged(
    thing: Thing, looks: str, detections: Iterable[Detection], right: frozenset[str]
) -> Judgement:
    """Judgement by the best covering detection: of a correct name, else of a wrong one."""
    over = [d for d in detections if iou(d.box_xyxy, thing.box_xyxy) >= COVERS_IOU]
    over.sort(key=lambda d: (d.class_name in right, d.score), reverse=True)
    if not over:
        return Judgement(looks, thing.class_name, "", 0.0, False)
    best = over[0]
    return Judgement(looks, thing.class_name, best.class_name, best.score, best.class_name in right)


def rows_of(sights: Iterable[Judgement]) -> dict[tuple[str, str], Row]:
    """Counts by (class, looks)."""
    groups: dict[tuple[str, str], list[Judgement]] = {}
    for sight in sights:
        groups.setdefault((sight.class_name, sight.looks), []).append(sight)
    return {
        key: Row(
            len(group),
            sum(s.recognised for s in group),
            tuple(Counter(s.found for s in group if s.found and not s.recognised).most_common(3)),
        )
        for key, group in groups.items()
    }


def table(rows: Mapping[tuple[str, str], Row], right: Mapping[str, frozenset[str]]) -> str:
    """Markdown table, most recognised classes first."""
    names = sorted({name for name, _ in rows})

    def share(name: str, looks: str) -> float:
        row = rows.get((name, looks))
        return row.recognised / row.seen if row else -1.0

    names.sort(key=lambda n: (-max(share(n, REALISTIC), share(n, PARAMETRIC)), n))
    lines = [
        "| thing | counts as | parametric: recognised | else taken for | realistic: recognised "
        "| else taken for |",
        "|---|---|---|---|---|---|",
    ]
    for name in names:
        cells = [name, ", ".join(sorted(right[name]))]
        for looks in (PARAMETRIC, REALISTIC):
            row = rows.get((name, looks))
            if row is None:
                cells += ["–", "–"]
                continue
            cells.append(f"{row.recognised / row.seen:.0%} of {row.seen}")
            cells.append(", ".join(f"{wrong} {n}" for wrong, n in row.taken_for) or "nothing")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
