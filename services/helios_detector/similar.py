"""The most similar name of a fixed vocabulary, by the text model of the scorer `minilm`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from helios_detector.minilm import TextVectors
from helios_detector.vocabulary import normalised

ALIKE = 0.55  # cosine from which one name may stand in for another
AS = "a {}"


class NearestName:
    """Raises Unavailable, when made, where the text model is not installed."""

    def __init__(self, vocabulary: Sequence[str], threads: int = 1) -> None:
        self._names = [normalised(n) for n in vocabulary]
        self._vectors = TextVectors("by_similarity", threads)
        self._known: dict[str, str | None] = {}

    def __call__(self, asked: str) -> str | None:
        """None when nothing in the vocabulary is alike."""
        name = normalised(asked)
        if name not in self._known:
            cosines = (
                self._vectors([AS.format(n) for n in self._names])
                @ self._vectors([AS.format(name)])[0]
            )
            best = int(np.argmax(cosines))
            self._known[name] = self._names[best] if cosines[best] >= ALIKE else None
        return self._known[name]
