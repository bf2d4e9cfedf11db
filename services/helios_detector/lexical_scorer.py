"""The scorer that needs no download: lexical. It never looks at the pixels.

It relates the names of what the detector reports in a frame to the names in a prompt, by a table
of what is found near what (`affinity.toml`). So it is as good as the detector and the table:
a name that is not in the table scores the prior.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources

from helios_core.types import Frame

from helios_detector.backend import ScorerBackend, Seen
from helios_detector.vocabulary_matching import accepts, equals, known_names, normalised

PRIOR = 0.2  # nothing the table knows is seen, or the prompt has no known name
FLOOR = 0.05  # only unrelated things are seen
HOST_WEIGHT = 0.8  # sought things' usual furniture is seen
GUEST_WEIGHT = 0.5  # what usually stands on the sought furniture is seen
ROOM_WEIGHT = 0.4  # furniture of the same room is seen
PROMPTS_REMEMBERED = 256
STRONGEST_SHARE = 0.7  # of the score: the strongest relation; the rest is the mean over all seen


@dataclass(frozen=True)
class Affinity:
    """What is found near what. All names are the first of their synonyms."""

    hosts: Mapping[str, Mapping[str, float]]  # thing -> furniture -> weight
    rooms: Mapping[str, Mapping[str, float]]  # name -> room -> share, adding up to 1

    def knows(self, name: str) -> bool:
        """Whether seeing it says anything; a wall does not."""
        return key_of(name) in self.hosts or key_of(name) in self.rooms

    def relation(self, seen: str, sought: str) -> float:
        """How much seeing one name says that the other is near, 0 to 1."""
        if normalised(seen) in accepts(sought):
            return 1.0
        a, b = key_of(seen), key_of(sought)
        hosted = self.hosts.get(b, {}).get(a, 0.0) * HOST_WEIGHT
        hosting = self.hosts.get(a, {}).get(b, 0.0) * GUEST_WEIGHT
        rooms_a, rooms_b = self.rooms.get(a, {}), self.rooms.get(b, {})
        shared = sum(share * rooms_b.get(room, 0.0) for room, share in rooms_a.items())
        return max(hosted, hosting, ROOM_WEIGHT * shared)


def key_of(name: str) -> str:
    """One name for all that mean the same."""
    return min(equals(name))


@cache
def load_affinity() -> Affinity:
    """The table that is shipped."""
    text = resources.files("helios_detector").joinpath("affinity.toml").read_text()
    table = tomllib.loads(text)
    hosts = {
        key_of(thing): {key_of(place): float(w) for place, w in row.items()}
        for thing, row in table["hosts"].items()
    }
    weights: dict[str, dict[str, float]] = {}
    for room, row in table["rooms"].items():
        for name, weight in row.items():
            weights.setdefault(key_of(name), {})[room] = float(weight)
    for thing, places in hosts.items():  # a thing is in the rooms of the furniture it stands on
        if thing in weights:
            continue
        own: dict[str, float] = {}
        for place, weight in places.items():
            for room, in_room in weights.get(place, {}).items():
                own[room] = own.get(room, 0.0) + weight * in_room
        weights[thing] = own
    shares = {
        name: {room: w / sum(row.values()) for room, w in row.items()}
        for name, row in weights.items()
        if row
    }
    return Affinity(hosts, shares)


@cache
def furniture_names() -> tuple[str, ...]:
    """Furniture on which things are usual: what tells where one is."""
    return tuple(sorted({place for row in load_affinity().hosts.values() for place in row}))


@cache
def household_names() -> frozenset[str]:
    """Every name of a thing, a piece of furniture or a room in our tables."""
    affinity = load_affinity()
    return known_names() | affinity.hosts.keys() | affinity.rooms.keys()


@lru_cache(maxsize=PROMPTS_REMEMBERED)
def names_in(prompt: str) -> tuple[str, ...]:
    """The known names that a prompt holds, longest first; a word serves one name only."""
    rest, out = normalised(prompt), []
    for name in sorted(household_names(), key=lambda n: (-len(n), n)):
        rest, count = re.subn(rf"\b{re.escape(name)}(?:e?s)?\b", "\n", rest)
        if count:
            out.append(name)
    return tuple(out)


def combined(relations: Sequence[float], weights: Sequence[float]) -> float:
    """One score, 0.05 to 1, of how each seen thing relates to what is sought.

    `weights` are the detector's scores, 0 to 1; what is seen with a score of 0 says nothing.
    """
    if not any(weights):
        return FLOOR
    weighted = [r * w for r, w in zip(relations, weights, strict=True)]
    mean = sum(weighted) / sum(weights)
    strength = STRONGEST_SHARE * max(weighted) + (1 - STRONGEST_SHARE) * mean
    return FLOOR + (1 - FLOOR) * min(1.0, strength)


class LexicalScorer(ScorerBackend):
    """Scores names against names. Says so in its name."""

    name = "lexical"
    reads_names = True

    def __init__(self) -> None:
        self._affinity = load_affinity()

    def score(
        self, frame: Frame, seen: Sequence[Seen], prompts: Mapping[str, str]
    ) -> dict[str, float]:
        return {layer: self._score(seen, names_in(prompt)) for layer, prompt in prompts.items()}

    def _score(self, seen: Sequence[Seen], sought: tuple[str, ...]) -> float:
        seen = [s for s in seen if self._affinity.knows(s.class_name)]
        if not seen or not sought:
            return PRIOR
        relations = [
            max(self._affinity.relation(s.class_name, name) for name in sought) for s in seen
        ]
        return combined(relations, [s.score for s in seen])

    def warm_up(self) -> None:
        names_in("")

    def close(self) -> None:
        """Holds nothing."""
