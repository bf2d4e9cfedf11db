"""Random move tasks in a home: one object from one receptacle class to another."""

import math
from collections.abc import Collection, Mapping

import numpy as np
from helios_core.errors import InvalidInput

from helios_sim.home.home_types import Episode, Receptacle, SceneObject

_EDGE_M = 0.03


class NoTask(InvalidInput):
    """The home has no task of the wanted kind; an evaluation skips it."""


# Class names that in plain language also cover another class: a floor lamp is a lamp, an armchair
# is a chair. Benchmark tasks never use them, so that success does not depend on wording.
AMBIGUOUS = frozenset({"chair", "lamp", "plant", "pot plant"})

# Classes whose objects always roll. Tasks ask for no rolling object, so these would give away that
# an object is absent.
ROLLING = frozenset({"apple", "orange", "ball"})


def sample(
    receptacles: tuple[Receptacle, ...],
    objects: tuple[SceneObject, ...],
    rng: np.random.Generator,
) -> Episode:
    """Solvable task, preferably with an object class that is on one receptacle class only.

    Every receptacle of a generated home has space for one more object within reach, so any class
    except the start class can be the goal. Objects that roll are used only if there are no others.
    """
    class_of = {receptacle.name: receptacle.class_name for receptacle in receptacles}
    places: dict[str, set[str]] = {}
    for thing in objects:
        places.setdefault(thing.class_name, set()).add(class_of[thing.receptacle])
    steady = [thing for thing in objects if not thing.shape.rolls]
    single = [thing for thing in steady if len(places[thing.class_name]) == 1]
    candidates = single or steady or list(objects)
    thing = candidates[int(rng.integers(len(candidates)))]
    start = class_of[thing.receptacle]
    goals = sorted({name for name in class_of.values() if name != start})
    goal = goals[int(rng.integers(len(goals)))]
    return Episode(
        thing.class_name, start, goal, f"Move the {thing.class_name} from the {start} to the {goal}"
    )


def sample_any(
    receptacles: tuple[Receptacle, ...],
    objects: tuple[SceneObject, ...],
    rng: np.random.Generator,
) -> Episode:
    """Task in the style of the benchmark: object class, start receptacle, goal receptacle.

    Objects of the class on other receptacles are wrong. The probability of a class is proportional
    to its number of objects. Objects that roll are never used, because their rest position is
    random. No name is AMBIGUOUS. The goal has a surface on which the object fits.
    """
    class_of = {receptacle.name: receptacle.class_name for receptacle in receptacles}
    steady = [
        thing
        for thing in objects
        if not thing.shape.rolls
        and AMBIGUOUS.isdisjoint((thing.class_name, class_of[thing.receptacle]))
    ]
    wanted = _one_of(sorted(thing.class_name for thing in steady), rng)
    instances = [thing for thing in steady if thing.class_name == wanted]
    start = _one_of(sorted({class_of[thing.receptacle] for thing in instances}), rng)
    candidates = [thing for thing in instances if class_of[thing.receptacle] == start]
    goals = {
        host.class_name
        for host in receptacles
        if host.class_name not in (start, *AMBIGUOUS)
        and all(_fits(thing, host) for thing in candidates)
    }
    goal = _one_of(sorted(goals), rng)
    return Episode(wanted, start, goal, f"Move the {wanted} from the {start} to the {goal}")


def sample_among(
    receptacles: tuple[Receptacle, ...],
    objects: tuple[SceneObject, ...],
    rng: np.random.Generator,
    allowed_objects: Collection[str],
    allowed_receptacles: Collection[str],
) -> Episode:
    """Task as of `sample_any` whose three classes are allowed ones. Raises NoTask without any.

    First the object class is drawn, in proportion to its number of objects, then start and goal.
    """
    class_of = {receptacle.name: receptacle.class_name for receptacle in receptacles}
    hosts = set(allowed_receptacles) - AMBIGUOUS
    instances: dict[tuple[str, str], list[SceneObject]] = {}
    for thing in objects:
        start = class_of[thing.receptacle]
        good = thing.class_name in allowed_objects and thing.class_name not in AMBIGUOUS
        if good and start in hosts and not thing.shape.rolls:
            instances.setdefault((thing.class_name, start), []).append(thing)
    goals = {
        key: sorted(
            {
                host.class_name
                for host in receptacles
                if host.class_name in hosts - {key[1]} and all(_fits(t, host) for t in things)
            }
        )
        for key, things in instances.items()
    }
    drawn = sorted(key[0] for key, things in instances.items() if goals[key] for _ in things)
    if not drawn:
        raise NoTask(
            "no object of the allowed classes stands on furniture of the allowed classes with "
            "another such piece as the goal; take another home, or allow more classes"
        )
    wanted = _one_of(drawn, rng)
    start = _one_of(sorted(s for name, s in instances if name == wanted and goals[name, s]), rng)
    goal = _one_of(goals[wanted, start], rng)
    return Episode(wanted, start, goal, f"Move the {wanted} from the {start} to the {goal}")


def sample_absent(
    receptacles: tuple[Receptacle, ...],
    likely: Mapping[str, tuple[str, ...]],
    rng: np.random.Generator,
) -> Episode:
    """Task that asks for an object class that the home does not have.

    likely: the classes to draw from -> receptacle classes on which an object of the class is
    likely. The start is one of these if the home has one, else any receptacle class of the home.
    No name is AMBIGUOUS, and no class is ROLLING. Raises NoTask without a class, or with fewer
    than two receptacle classes.
    """
    wanted = sorted(set(likely) - AMBIGUOUS - ROLLING)
    hosts = sorted({receptacle.class_name for receptacle in receptacles} - AMBIGUOUS)
    if not wanted or len(hosts) < 2:
        raise NoTask(
            f"no task asks for an absent object: {len(wanted)} classes are absent, and the home "
            f"has {len(hosts)} kinds of receptacles; wanted at least 1 and 2; take another home"
        )
    name = _one_of(wanted, rng)
    start = _one_of([host for host in hosts if host in likely[name]] or hosts, rng)
    goal = _one_of([host for host in hosts if host != start], rng)
    return Episode(name, start, goal, f"Move the {name} from the {start} to the {goal}", True)


def _fits(thing: SceneObject, host: Receptacle) -> bool:
    radius = math.hypot(thing.size_m[0], thing.size_m[1]) / 2
    return any(
        radius + _EDGE_M <= min(surface.half_extent_xy) and thing.size_m[2] + 0.05 < surface.clear_m
        for surface in host.surfaces
    )


def _one_of(names: list[str], rng: np.random.Generator) -> str:
    return names[int(rng.integers(len(names)))]
