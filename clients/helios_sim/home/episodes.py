"""Tasks in a home: move one thing from one kind of furniture to another."""

import numpy as np

from helios_sim.home.types import Episode, Receptacle, SceneObject


def sample(
    receptacles: tuple[Receptacle, ...],
    objects: tuple[SceneObject, ...],
    rng: np.random.Generator,
) -> Episode:
    """A task that can be solved, by preference one that names a single place to find the thing.

    Every receptacle of a generated home has room for one more thing within reach, so any class
    but the start's can be the goal. Things that roll are asked for only where nothing else is.
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
