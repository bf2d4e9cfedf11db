"""Search classes of one context, prepared once for the errors of all its frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from helios_core.name_rules import plain
from numpy.typing import NDArray

from helios_detector.simulation.remembered_draws import RememberedDraws
from helios_detector.simulation.view_noise import Shares, keys_of
from helios_detector.vocabulary_matching import SearchTarget


class Search:
    """Search classes, the names that match them, and the draws that each class needs."""

    def __init__(self, wanted: Sequence[SearchTarget], shares: Shares) -> None:
        """shares: of the draws, from the noise table."""
        self.wanted, self._shares = tuple(wanted), shares
        self.is_object = np.array([w.is_object for w in wanted], bool)  # [p]

    @cached_property
    def _by_name(self) -> Mapping[str, tuple[int, ...]]:
        out: dict[str, list[int]] = {}
        for k, want in enumerate(self.wanted):
            for name in want.names:
                out.setdefault(name, []).append(k)
        return {name: tuple(places) for name, places in out.items()}

    def matching(self, name: str) -> tuple[int, ...]:
        """Places in `wanted` of the classes that a name matches, ascending; the name normalised."""
        return self._by_name.get(name, ())

    def keys(self, what: str) -> NDArray[np.uint64]:
        """Keys [p] of the draws for one purpose of each class."""
        return keys_of([f"{what} {plain(w.name)}" for w in self.wanted])

    @cached_property
    def false(self) -> RememberedDraws:
        """Draws of false positives: whether a surface shows a class."""
        return RememberedDraws(self.keys("exists"), self._shares)

    @cached_property
    def false_keys(self) -> NDArray[np.uint64]:
        """Keys [p, 2] of the draws for score and size of a false positive."""
        return np.stack([self.keys("score"), self.keys("size")], -1)

    @cached_property
    def other(self) -> RememberedDraws:
        """Draws of other names: whether an object is also reported as a class."""
        return RememberedDraws(self.keys("as"), self._shares)

    @cached_property
    def other_keys(self) -> NDArray[np.uint64]:
        """Keys [p, 1] of the draws for the scores of other names."""
        return self.keys("as, score")[:, None]
