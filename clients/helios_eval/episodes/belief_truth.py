"""Was it true? What the object map believes of an instance, held against the home's truth.

The rule. An instance is right when a true thing of its class is where it says that one is:

- a thing to be carried (role "object"): the instance's centre lies in the thing's box, turned by
  the thing's yaw and grown by 0.10 m on every side;
- a receptacle (roles "start" and "goal"): the centre lies over the receptacle's footprint, turned
  and grown by 0.15 m on every side, and not more than 0.15 m below or above its box. Surfaces,
  fronts and legs all count, because a receptacle's instance is often only the part that was seen.

Class names are compared as the detector compares them: letter case, underscores and hyphens do not
matter, synonyms and kinds do ("table" is not right on a coffee table, as in the metrics). Each
instance is judged alone: two instances on one thing are both right.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal, Protocol

from helios_core.types import ObjectInstance
from helios_detector.vocabulary_matching import normalised

from helios_eval.episodes.episode_record import Belief

Role = Literal["object", "start", "goal"]

OBJECT_MARGIN_M = 0.10
RECEPTACLE_MARGIN_M = 0.15


class TrueThing(Protocol):
    """A thing or a receptacle as it stands now, from the simulator."""

    @property
    def class_name(self) -> str: ...

    @property
    def center_m(self) -> Sequence[float]:
        """Middle of its box [3], world."""
        ...

    @property
    def size_m(self) -> Sequence[float]:
        """Of its box [3], before it is turned by `yaw_rad`."""
        ...

    @property
    def yaw_rad(self) -> float: ...


def judged(
    objects: Sequence[ObjectInstance],
    things: Sequence[TrueThing],
    roles: Mapping[str, Role],
    step: int,
) -> list[Belief]:
    """Beliefs about the instances whose class has a role; the order of `objects` is kept.

    roles: class name -> what it is to the task. Instances of other classes are left out.
    """
    role_of: dict[str, Role] = {normalised(name): role for name, role in roles.items()}
    by_class: dict[str, list[TrueThing]] = {}
    for thing in things:
        by_class.setdefault(normalised(thing.class_name), []).append(thing)
    out = []
    for instance in objects:
        name = normalised(instance.class_name)
        role = role_of.get(name)
        if role is None:
            continue
        correct = any(is_at(instance, thing, role) for thing in by_class.get(name, ()))
        out.append(
            Belief(
                step=step,
                instance=instance.id,
                role=role,
                class_name=instance.class_name,
                class_score=instance.class_score,
                score=instance.score,
                uncertainty=instance.uncertainty,
                views=instance.views,
                gaussians=instance.gaussians,
                correct=correct,
            )
        )
    return out


def is_at(instance: ObjectInstance, thing: TrueThing, role: Role) -> bool:
    """Whether the instance's centre is within the thing's grown box, whatever the classes."""
    margin_m = OBJECT_MARGIN_M if role == "object" else RECEPTACLE_MARGIN_M
    dx, dy, dz = (float(a) - b for a, b in zip(instance.center_m, thing.center_m, strict=True))
    c, s = math.cos(thing.yaw_rad), math.sin(thing.yaw_rad)
    along = (c * dx + s * dy, c * dy - s * dx, dz)
    return all(
        abs(offset) <= size / 2 + margin_m for offset, size in zip(along, thing.size_m, strict=True)
    )
