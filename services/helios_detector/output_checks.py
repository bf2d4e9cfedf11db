"""Validation of back-end outputs, which may come from external packages.

Valid entries pass. Each invalid entry is dropped, counted under a name that `/metrics` shows, and
described in one sentence: the given value and the expected one.

    scores_clipped       score outside 0 to 1: clipped
    detections_refused   detection of a wrong type or class, or that does not fit the image
    seen_refused         entry of `seen` of a wrong type, or without a number as its score
    boxes_widened        mask larger than its box: the box is widened, as only its inside is sent
    scores_refused       scorer's entry for a layer not requested, or that is not a number;
                         requested layer without a score
    embeddings_refused   image embedding of a wrong type or shape, or not finite
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from numbers import Integral
from typing import Any

import numpy as np
from helios_core.errors import Internal
from helios_core.types import Detection, Embedding

from helios_detector.backend import Findings, Judgement, Seen
from helios_detector.box_to_mask import Box
from helios_detector.detection_filtering import box_of

ROUNDING = 1e-3  # a score up to this far outside 0 to 1 is clipped without a warning
MOST_NAMED = 8  # most names of one list in a message
MOST_CHARACTERS = 80  # longest value in a message


@dataclass
class OutputFaults:
    """The faults found in one output of a back end."""

    counts: Counter[str] = field(default_factory=Counter)  # by the counter names of the module
    descriptions: dict[str, str] = field(
        default_factory=dict
    )  # kind -> description of its first fault
    kind_counts: Counter[str] = field(default_factory=Counter)  # kind -> number of faults

    def __bool__(self) -> bool:
        return bool(self.counts)

    def note(self, counter: str, kind: str, said: str) -> None:
        """Record one fault."""
        self.counts[counter] += 1
        self.descriptions.setdefault(kind, said)
        self.kind_counts[kind] += 1

    @property
    def sentence(self) -> str:
        """Description of every kind of fault, once each; empty without faults."""
        return "; ".join(
            said + (f" ({self.kind_counts[kind]} times)" if self.kind_counts[kind] > 1 else "")
            for kind, said in self.descriptions.items()
        )


def checked_findings(
    findings: object, shape: tuple[int, int], asked: Collection[str] | None = None
) -> tuple[Findings, OutputFaults]:
    """(valid findings, faults). A detection with an empty mask is no fault, but it is left out: the
    maps cannot use it.

    shape: (height, width) of the image. asked: class names of the search context; None: any.
    Raises Internal when the whole output is unusable.
    """
    if not isinstance(findings, Findings):
        raise Internal(f"{_a(findings)}, wanted Findings(detections, seen)")
    wrong = OutputFaults()
    given = [
        _detection(d, shape, asked, wrong) for d in _entries(findings.detections, "detections")
    ]
    detections = tuple(d for d in given if d is not None and d.mask.any())
    seen = tuple(
        s for s in [_seen(s, wrong) for s in _entries(findings.seen, "seen")] if s is not None
    )
    return Findings(detections, seen), wrong


def checked_judgement(judgement: object, layers: Collection[str]) -> tuple[Judgement, OutputFaults]:
    """(valid judgement, faults). layers: the requested value layers.

    Raises Internal when the whole output is unusable.
    """
    if not isinstance(judgement, Judgement):
        raise Internal(f"{_a(judgement)}, wanted Judgement(scores, image)")
    wanted = f"wanted a score of 0 to 1 for each of {_names(layers)}"
    if not isinstance(judgement.scores, Mapping):
        raise Internal(f"{_a(judgement.scores)}, {wanted}")
    wrong, scores = OutputFaults(), {}
    for layer, given in judgement.scores.items():
        if layer not in layers:
            wrong.note("scores_refused", "layer", f"a score for {_short(layer)}, {wanted}")
        elif (score := _score(given, wrong, f"as the score of {layer!r}")) is None:
            wrong.counts["scores_refused"] += 1
        else:
            scores[layer] = score
    if missing := [layer for layer in layers if layer not in judgement.scores]:
        said = f"no score for {_names(missing)}"
        wrong.note("scores_refused", "missing", said if wrong.descriptions else f"{said}, {wanted}")
    image = _embedding(judgement.image, wrong)
    if not wrong:
        return judgement, wrong
    return replace(judgement, scores=scores, image=image), wrong


def checked_refusals(refused: object) -> dict[str, str]:
    """Validated output of `DetectorBackend.refused`. Raises Internal."""
    if isinstance(refused, Mapping) and all(
        isinstance(name, str) and isinstance(why, str) for name, why in refused.items()
    ):
        return dict(refused)
    raise Internal(f"{_a(refused)}, wanted a dict of class name to the sentence why not")


def checked_vocabulary(vocabulary: object) -> tuple[str, ...] | None:
    """Validated output of `DetectorBackend.vocabulary`. Raises Internal."""
    if vocabulary is None:
        return None
    if isinstance(vocabulary, Collection) and not isinstance(vocabulary, str | bytes | Mapping):
        names = tuple(vocabulary)
        if names and all(isinstance(name, str) and name.strip() for name in names):
            return names
    raise Internal(
        f"{_a(vocabulary)} ({_short(vocabulary)}), wanted a tuple of names, or None for any name"
    )


def _detection(
    d: object, shape: tuple[int, int], asked: Collection[str] | None, wrong: OutputFaults
) -> Detection | None:
    if not isinstance(d, Detection):
        wrong.note("detections_refused", "type", f"{_a(d)} among detections, wanted Detection")
        return None
    if not isinstance(d.class_name, str) or (asked is not None and d.class_name not in asked):
        names = _names(asked) if asked is not None else "names"
        wrong.note(
            "detections_refused",
            "class",
            f"a detection with class_name {_short(d.class_name)}, wanted one of {names}",
        )
        return None
    of = f"of {d.class_name!r}"
    if said := _mask_fault(d.mask, shape) or _box_fault(d.box_xyxy, shape):
        wrong.note("detections_refused", said[0], f"a detection {of} with {said[1]}")
        return None
    score = _score(d.score, wrong, f"as the score of a detection {of}")
    if score is None:
        wrong.counts["detections_refused"] += 1
        return None
    x0, y0, x1, y1 = (int(v) for v in d.box_xyxy)
    box = x0, y0, x1, y1
    if np.count_nonzero(d.mask) > np.count_nonzero(d.mask[y0:y1, x0:x1]):
        box = _around(box, box_of(d.mask))
        wrong.counts["boxes_widened"] += 1
    as_it_is = score == d.score and isinstance(d.box_xyxy, tuple) and box == d.box_xyxy
    return d if as_it_is else replace(d, score=score, box_xyxy=box)


def _mask_fault(mask: object, shape: tuple[int, int]) -> tuple[str, str] | None:
    """(kind, description with the given and the expected value); None for a valid mask."""
    wanted = f"wanted bool {shape}, as large as the image"
    if not isinstance(mask, np.ndarray):
        return "mask", f"{_a(mask)} as its mask, {wanted}"
    if mask.shape != shape or mask.dtype != bool:
        return "mask", f"a mask {mask.dtype} {mask.shape}, {wanted}"
    return None


def _box_fault(box: Any, shape: tuple[int, int]) -> tuple[str, str] | None:
    """(kind, description) as in `_mask_fault`; None for a valid box."""
    height, width = shape
    wanted = f"wanted whole x0 < x1 of 0 to {width} and y0 < y1 of 0 to {height}"
    try:
        x0, y0, x1, y1 = box
    except (TypeError, ValueError):
        return "box", f"box_xyxy {_short(box)}, {wanted}"
    whole = all(isinstance(v, Integral) for v in (x0, y0, x1, y1))
    if not (whole and 0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        return "box", f"box_xyxy {_short(box)}, {wanted}"
    return None


def _seen(seen: object, wrong: OutputFaults) -> Seen | None:
    if not isinstance(seen, Seen) or not isinstance(seen.class_name, str):
        said = f"{_a(seen)} in seen, wanted Seen(class_name, score)"
        wrong.note("seen_refused", "seen", said)
        return None
    score = _score(seen.score, wrong, f"as the score of {seen.class_name!r} in seen")
    if score is None:
        wrong.counts["seen_refused"] += 1
        return None
    return seen if score == seen.score else replace(seen, score=score)


def _score(given: Any, wrong: OutputFaults, what: str) -> float | None:
    """The score clipped to 0 to 1; None if it is not a number."""
    try:
        score = math.nan if isinstance(given, str | bytes | bool) else float(given)
    except (TypeError, ValueError):
        score = math.nan
    if math.isnan(score):
        _say(wrong, "score", f"{_short(given)} {what}, wanted a number from 0 to 1")
        return None
    if 0 <= score <= 1:
        return score
    cut = min(1.0, max(0.0, score))
    wrong.counts["scores_clipped"] += 1
    if abs(score - cut) > ROUNDING:
        _say(wrong, "range", f"{score:g} {what}, wanted 0 to 1; it was cut to {cut:g}")
    return cut


def _embedding(image: object, wrong: OutputFaults) -> Embedding | None:
    if image is None:
        return None
    if isinstance(image, Embedding):
        vectors = np.asarray(image.vectors)
        numbers = vectors.ndim == 2 and np.issubdtype(vectors.dtype, np.floating)
        if numbers and np.isfinite(vectors).all():
            return image
        came = f"an embedding {vectors.dtype} {vectors.shape}"
        came += " with what is no number" if numbers else ""
    else:
        came = f"{_a(image)} as image"
    wanted = "wanted Embedding(model, vectors) with finite float32 [rows, d], or None"
    wrong.note("embeddings_refused", "embedding", f"{came}, {wanted}")
    return None


def _say(wrong: OutputFaults, kind: str, said: str) -> None:
    """Record a fault's description; the caller counts it."""
    wrong.descriptions.setdefault(kind, said)
    wrong.kind_counts[kind] += 1


def _entries(given: Any, what: str) -> Iterable[object]:
    """The entries as a tuple. Raises Internal when `given` is not a list-like value."""
    if isinstance(given, Iterable) and not isinstance(given, str | bytes | Mapping):
        return tuple(given)
    raise Internal(f"Findings with {_a(given)} as {what}, wanted a tuple")


def _a(value: object) -> str:
    """Description of a value by its type."""
    return "None" if value is None else f"a value of type {type(value).__name__}"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= MOST_CHARACTERS else f"{text[:MOST_CHARACTERS]}…"


def _names(names: Collection[str]) -> str:
    some = [repr(name) for name in sorted(names)][:MOST_NAMED]
    more = len(names) - len(some)
    return ", ".join(some) + (f" and {more} more" if more else "") if some else "no name"


def _around(a: Box, b: Box) -> Box:
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])
