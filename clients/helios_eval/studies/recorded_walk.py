"""A walk through a home with a noisy detector, recorded once for any number of maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from helios_client.usage_errors import UsageError
from helios_core.types import ObjectInstance, Role, SearchContext
from helios_objectmap.object_map import ObjectMap
from helios_objectmap.settings import ObjectMapSettings

from helios_eval.episodes.belief_truth import TrueObject
from helios_eval.episodes.episode_player import running_stack
from helios_eval.episodes.episode_record import Setting
from helios_eval.studies.map_growth.observation_log import Seen, by_helios, recorded

# No candidate reaches these thresholds, so the whole home is searched once.
_ONLY_LOOKS: Mapping[str, Setting] = {
    "planner.tau_g": 5.0,
    "planner.pick_at_last": 1.0,
    "planner.rounds": 1,
}
THRESHOLDS = {
    Role.OBJECT: "planner.od_g",
    Role.START_RECEPTACLE: "planner.od_a",
    Role.GOAL_RECEPTACLE: "planner.od_b",
}


@dataclass(frozen=True)
class Walk:
    """Observations of a walk, its task, and the true objects of the home."""

    seed: int
    object: str
    start: str
    goal: str
    things: tuple[TrueObject, ...]
    targets: tuple[TrueObject, ...]  # those of the object's class on a start receptacle
    seen: tuple[Seen, ...]


def walk(
    preset: str, seed: int, max_steps: int, stride_px: int, thresholds: Mapping[Role, float]
) -> Walk:
    """Walk of `helios-paper` with the task of a seed, without picking.

    thresholds: of the detector. Frames are reduced to the pixels that a map with that stride uses.
    Raises HeliosError.
    """
    settings = {**_ONLY_LOOKS, **{THRESHOLDS[role]: least for role, least in thresholds.items()}}
    with running_stack(by_helios(preset, seed, settings)) as (thread, stack):
        task = thread.run(lambda world: world.episode)
        things = thread.run(lambda world: tuple(world.object_states()))
        names = thread.run(lambda world: frozenset(world.tracker.targets.objects))
        seen = recorded(stack, task.instruction, max_steps, stride_px)
    if not seen:
        raise UsageError(f"the walk of seed {seed} showed nothing in {max_steps} steps")
    return Walk(
        seed,
        task.object_class,
        task.start_receptacle_class,
        task.goal_receptacle_class,
        things,
        tuple(t for t in things if t.name in names),
        tuple(seen),
    )


def believed(
    seen: Sequence[Seen], settings: ObjectMapSettings, thresholds: Mapping[Role, float]
) -> tuple[ObjectInstance, ...]:
    """Instances of a map after all observations.

    settings: with the stride of the recording already applied. thresholds: of the detector;
    detections below them are left out.
    """
    known = ObjectMap(settings)
    for one in seen:
        context = _with(one.context, thresholds)
        least = {c.name: c.threshold for c in context.classes}
        found = tuple(
            d for d in one.observation.detections if d.score >= least.get(d.class_name, 0.0)
        )
        known.update(replace(one.observation, detections=found), context, one.held)
    return known.objects()


def _with(context: SearchContext, thresholds: Mapping[Role, float]) -> SearchContext:
    classes = tuple(
        replace(c, threshold=max(c.threshold, thresholds[c.role])) for c in context.classes
    )
    return replace(context, classes=classes)
