"""The most similar name of a fixed vocabulary, by the text model of the scorer `minilm`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from helios_core.name_rules import plain
from numpy.typing import NDArray

from helios_detector.minilm_scorer import TextVectors

MIN_COSINE = 0.55  # cosine from which one name may substitute another
AS = "a {}"


class NearestName:
    """Search for the most similar name of a vocabulary. Thread-safe.

    The constructor raises Unavailable if the text model is not installed.
    """

    def __init__(self, vocabulary: Sequence[str], threads: int = 1) -> None:
        self._names = [plain(n) for n in vocabulary]
        self._vectors = TextVectors("by_similarity", threads)

    def __call__(self, asked: str) -> str | None:
        """The most similar name; None if no cosine reaches `MIN_COSINE`. Raises like
        `HfModel.use`."""
        cosines = self._known @ self._vectors([AS.format(plain(asked))])[0]
        best = int(np.argmax(cosines))
        return self._names[best] if cosines[best] >= MIN_COSINE else None

    def warm_up(self) -> None:
        """Load the text model and embed the vocabulary. Raises Unavailable when it cannot work."""
        self(self._names[0])

    def unload(self) -> None:
        """Free the text model's memory; the next new name loads it again."""
        self._vectors.model.unload()

    @cached_property
    def _known(self) -> NDArray[np.float32]:
        """Embeddings [names, 384] of the vocabulary."""
        return self._vectors([AS.format(n) for n in self._names])
