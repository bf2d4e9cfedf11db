"""Classes of the pixels that lie in several masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from helios_core.types import Detection
from helios_objectmap.fusion.label_image import read
from objectmap_scene import CONTEXT, ROOM, looking_at, mug_at, observe

FURNITURE = [c.name for c in CONTEXT.distinct() if c.role.is_receptacle]
SEEN = observe((*ROOM, mug_at(1.2, 0.0)), looking_at(0.0, 0.0, (1.2, 0.0, 0.8)))
MUG = next(d for d in SEEN.detections if d.class_name == "mug")


def label_of_the_mug(detections: Sequence[Detection], by_score: bool) -> str:
    image = read(replace(SEEN, detections=tuple(detections)), CONTEXT, 1, 0.25, 8.0, by_score)
    number = np.unique(image.labels[MUG.mask])
    assert len(number) == 1
    return CONTEXT.distinct()[int(number[0]) - 1].name


def called(name: str, score: float, mask: np.ndarray = MUG.mask) -> Detection:
    return replace(MUG, class_name=name, score=score, mask=mask)


@pytest.mark.parametrize(("first", "second"), [(0.9, 0.6), (0.6, 0.9)])
def test_by_score_the_better_name_of_one_mask_wins_in_either_order(first, second) -> None:
    pair = [called("mug", first), called(FURNITURE[0], second)]
    wanted = "mug" if first > second else FURNITURE[0]
    assert label_of_the_mug(pair, by_score=True) == wanted
    assert label_of_the_mug(pair[::-1], by_score=True) == wanted


@pytest.mark.parametrize("scores", [(0.9, 0.6), (0.6, 0.9)])
def test_by_name_the_alphabetically_last_wins_whatever_its_score(scores) -> None:
    pair = [called("mug", scores[0]), called(FURNITURE[0], scores[1])]
    assert label_of_the_mug(pair, by_score=False) == max("mug", FURNITURE[0])


@pytest.mark.parametrize("by_score", [False, True])
def test_the_smaller_mask_wins_whatever_its_score(by_score: bool) -> None:
    around = np.ones_like(MUG.mask)
    pair = [called("mug", 0.5), called(FURNITURE[0], 0.99, around)]
    assert label_of_the_mug(pair, by_score) == "mug"
