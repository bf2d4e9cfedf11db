"""Tasks that ask for an object that is not in the home: which homes get one, and which class.

Whether a home gets such a task depends on its seed and on the share alone, so all agents play the
same tasks, and a larger share keeps the homes of a smaller one. The draws are independent of those
of the home and of its ordinary task.
"""

from __future__ import annotations

import numpy as np
from helios_core.name_rules import plain
from helios_detector.vocabulary_matching import accepted_names, synonyms_of
from helios_sim.home import Episode, Home
from helios_sim.home.catalogs import CATALOGS
from helios_sim.home.task_sampling import sample_absent

# Object classes that the shapes of furniture contain, as parts that cannot be picked.
PARTS = {
    "sofa": ("cushion",),
    "armchair": ("cushion",),
    "bed": ("cushion",),
    "bookcase": ("book", "basket"),
    "shelf": ("basket",),
    "towel rail": ("towel",),
}
_WHETHER, _WHICH = 0xAB5E, 0xAB5F  # streams of the two draws


def is_drawn(seed: int, share: float) -> bool:
    """True if the home of a seed gets a task with an absent object. share: 0 to 1."""
    return bool(np.random.default_rng([seed, _WHETHER]).random() < share)


def absent_classes(home: Home) -> list[str]:
    """Object classes of the catalog that the home does not have, by name.

    A class is left out if anything in the home, also furniture and its `PARTS`, has its name, a
    synonym, a narrower or a wider name ("ball" while there is a tennis ball, and the reverse).
    """
    there = {thing.class_name for thing in (*home.objects, *home.receptacles, *home.fixtures)}
    there |= {part for name in there for part in PARTS.get(name, ())}
    accepted = frozenset[str]().union(*map(accepted_names, there))
    names = {plain(name) for name in there}
    return sorted(
        name
        for name in CATALOGS[home.preset.catalog].objects
        if accepted.isdisjoint(synonyms_of(name)) and names.isdisjoint(accepted_names(name))
    )


def absent_episode_of(home: Home, seed: int) -> Episode:
    """Move task that asks for an absent object. Raises InvalidInput if no class is absent."""
    objects = CATALOGS[home.preset.catalog].objects
    likely = {name: objects[name][1] for name in absent_classes(home)}
    return sample_absent(home.receptacles, likely, np.random.default_rng([seed, _WHICH]))
