"""Prompts for a text-prompted model, and the class that owns each prompt. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.name_rules import plain
from helios_core.types import SearchContext
from numpy.typing import NDArray

from helios_detector.backend import SEEN_SCORE
from helios_detector.vocabulary_matching import SearchTarget, open_wanted


@dataclass(frozen=True)
class Phrases:
    """The prompts of one search context. Class i of `wanted` owns the texts with owner i."""

    wanted: tuple[SearchTarget, ...]
    landmarks: tuple[str, ...]  # extra classes, numbered after the wanted ones
    texts: tuple[str, ...]
    owner: NDArray[np.intp]  # [texts] index into wanted + landmarks

    @property
    def thresholds(self) -> NDArray[np.float32]:
        """Score threshold of each class, landmarks included: [classes]."""
        asked = [w.threshold for w in self.wanted]
        return np.array([*asked, *(SEEN_SCORE for _ in self.landmarks)], np.float32)

    def by_class(self, scores: NDArray[np.float32]) -> NDArray[np.float32]:
        """Scores [n, classes] from [n, texts]: the maximum over each class's texts."""
        out = np.zeros((len(scores), len(self.wanted) + len(self.landmarks)), np.float32)
        for column, c in enumerate(self.owner):
            np.maximum(out[:, c], scores[:, column], out=out[:, c])
        return out


def clean(name: str) -> str:
    """The name as a prompt, without full stops, which separate phrases for Grounding DINO."""
    return " ".join(plain(name).replace(".", " ").replace(",", " ").split())


def phrases_of(context: SearchContext, landmarks: Sequence[str] = ()) -> Phrases:
    """Prompts of the context's names and synonyms and the landmarks; each text has one class."""
    wanted = open_wanted(context)
    synonyms: dict[str, list[str]] = {}
    for c in context.classes:
        synonyms.setdefault(plain(c.name), []).extend(c.synonyms)
    taken: dict[str, int] = {}
    for i, want in enumerate(wanted):  # names first, so that no synonym takes another class's name
        taken.setdefault(clean(want.name), i)
    for i, want in enumerate(wanted):
        for synonym in synonyms.get(plain(want.name), ()):
            taken.setdefault(clean(synonym), i)
    asked = frozenset().union(*(w.names for w in wanted)) if wanted else frozenset()
    extra = tuple(n for n in landmarks if plain(n) not in asked and clean(n) not in taken)
    for i, name in enumerate(extra):
        taken.setdefault(clean(name), len(wanted) + i)
    taken.pop("", None)
    return Phrases(wanted, extra, tuple(taken), np.array(list(taken.values()), np.intp))
