"""What a back end gave, held to its contract. Outside packages are as fallible as anybody.

What can be mended is mended, what cannot is left out, and each of it is counted under a name that
`helios status` and `/metrics` show:

    scores_clipped       a score outside 0 to 1: cut to it
    detections_refused   a score that is no number, a box or a mask that does not fit the image
    boxes_widened        a mask that goes beyond its box: only what is in the box would be sent
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
from helios_core.errors import Internal
from helios_core.types import Detection

from helios_detector.backend import Findings, Judgement, Seen
from helios_detector.box_to_mask import Box
from helios_detector.boxes import box_of

Counts = Counter[str]


def held_findings(findings: Findings, shape: tuple[int, int]) -> tuple[Findings, Counts]:
    """(what may be sent, what was wrong); `shape` is (height, width) of the image."""
    counts: Counts = Counter()
    detections = [_detection(d, shape, counts) for d in findings.detections]
    seen = [_seen(s, counts) for s in findings.seen]
    if not counts:
        return findings, counts
    kept = tuple(d for d in detections if d is not None)
    return Findings(kept, tuple(s for s in seen if s is not None)), counts


def held_judgement(judgement: Judgement, scorer: str) -> tuple[Judgement, Counts]:
    """Raises Internal for a score that is no number."""
    counts: Counts = Counter()
    scores = {}
    for layer, score in judgement.scores.items():
        if math.isnan(score):
            raise Internal(f"{scorer} gave no number as the score of {layer!r}; see its log")
        scores[layer] = _clipped(score, counts)
    return (replace(judgement, scores=scores) if counts else judgement), counts


def _detection(d: Detection, shape: tuple[int, int], counts: Counts) -> Detection | None:
    if math.isnan(d.score) or d.mask.shape != shape or d.mask.dtype != bool:
        counts["detections_refused"] += 1
        return None
    x0, y0, x1, y1 = d.box_xyxy
    if not (0 <= x0 < x1 <= shape[1] and 0 <= y0 < y1 <= shape[0]):
        counts["detections_refused"] += 1
        return None
    score, box = _clipped(d.score, counts), d.box_xyxy
    if np.count_nonzero(d.mask) > np.count_nonzero(d.mask[y0:y1, x0:x1]):
        box = _around(box, box_of(d.mask))
        counts["boxes_widened"] += 1
    return d if (score, box) == (d.score, d.box_xyxy) else replace(d, score=score, box_xyxy=box)


def _seen(seen: Seen, counts: Counts) -> Seen | None:
    if math.isnan(seen.score):
        counts["detections_refused"] += 1
        return None
    score = _clipped(seen.score, counts)
    return seen if score == seen.score else replace(seen, score=score)


def _clipped(score: float, counts: Counts) -> float:
    if 0 <= score <= 1:
        return score
    counts["scores_clipped"] += 1
    return min(1.0, max(0.0, score))


def _around(a: Box, b: Box) -> Box:
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])
