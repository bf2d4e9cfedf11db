"""The scorer `lexical`, which needs no download and does not use the pixels.

It relates the class names that the detector reports in a frame to the names in a prompt by a table
of names that occur near each other (`affinity.toml`). Its quality is limited by the detector and
the table: a name outside the table scores the prior.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources

from helios_core.name_rules import plain
from helios_core.types import Frame

from helios_detector.backend import ScorerBackend, Seen
from helios_detector.vocabulary_matching import accepted_names, known_names, synonyms_of

PRIOR = 0.2  # score if no seen name is in the table, or the prompt has no known name
FLOOR = 0.05  # score if only unrelated objects are seen
HOST_WEIGHT = 0.8  # the usual furniture of the sought object is seen
CARRIED_OBJECT_WEIGHT = 0.5  # an object that usually stands on the sought furniture is seen
ROOM_WEIGHT = 0.4  # furniture of the same room is seen
PROMPTS_REMEMBERED = 256
STRONGEST_SHARE = 0.7  # weight of the strongest relation; the rest weighs the mean over all seen


@dataclass(frozen=True)
class Affinity:
    """Table of names that occur near each other. All names are the first of their synonyms."""

    hosts: Mapping[str, Mapping[str, float]]  # object -> furniture -> weight
    rooms: Mapping[str, Mapping[str, float]]  # name -> room -> share; shares add up to 1

    def knows(self, name: str) -> bool:
        """True if the table relates the name to anything; a wall is not in it."""
        return key_of(name) in self.hosts or key_of(name) in self.rooms

    def relation(self, seen: str, sought: str) -> float:
        """Strength, 0 to 1, with which one seen name indicates that the sought one is near."""
        if plain(seen) in accepted_names(sought):
            return 1.0
        a, b = key_of(seen), key_of(sought)
        hosted = self.hosts.get(b, {}).get(a, 0.0) * HOST_WEIGHT
        hosting = self.hosts.get(a, {}).get(b, 0.0) * CARRIED_OBJECT_WEIGHT
        rooms_a, rooms_b = self.rooms.get(a, {}), self.rooms.get(b, {})
        shared = sum(share * rooms_b.get(room, 0.0) for room, share in rooms_a.items())
        return max(hosted, hosting, ROOM_WEIGHT * shared)


@lru_cache(maxsize=4096)
def key_of(name: str) -> str:
    """Canonical name: the alphabetically first of its synonyms."""
    return min(synonyms_of(name))


@cache
def load_affinity() -> Affinity:
    """The affinity table of this package."""
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
    for thing, places in hosts.items():  # an object inherits the rooms of its furniture
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
    """Furniture that usually carries objects; it serves as landmarks."""
    return tuple(sorted({place for row in load_affinity().hosts.values() for place in row}))


@cache
def household_names() -> frozenset[str]:
    """Every name in the synonym and affinity tables."""
    affinity = load_affinity()
    return known_names() | affinity.hosts.keys() | affinity.rooms.keys()


@lru_cache(maxsize=PROMPTS_REMEMBERED)
def names_in(prompt: str) -> tuple[str, ...]:
    """The known names in a prompt, longest first; each word counts for one name only."""
    rest, out = plain(prompt), []
    for name in sorted(household_names(), key=lambda n: (-len(n), n)):
        rest, count = re.subn(rf"\b{re.escape(name)}(?:e?s)?\b", "\n", rest)
        if count:
            out.append(name)
    return tuple(out)


def combined(relations: Sequence[float], weights: Sequence[float]) -> float:
    """Score, 0.05 to 1, from the relation of each seen object to the sought one.

    `weights` are the detector's scores, 0 to 1; an object with score 0 has no influence.
    """
    if not any(weights):
        return FLOOR
    weighted = [r * w for r, w in zip(relations, weights, strict=True)]
    mean = sum(weighted) / sum(weights)
    strength = STRONGEST_SHARE * max(weighted) + (1 - STRONGEST_SHARE) * mean
    return FLOOR + (1 - FLOOR) * min(1.0, strength)


class LexicalScorer(ScorerBackend):
    """Scorer of detected class names against the names in a prompt."""

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
        """No resources to free."""
