"""Judgement of the object map's instances against the home's ground truth.

An instance is correct if a true object or receptacle of its class is at its centre:

- object to carry (role "object"): the instance's centre lies in the object's box, turned by the
  object's yaw and grown by 0.10 m on every side;
- receptacle (roles "start" and "goal"): the centre lies over the receptacle's footprint, turned
  and grown by 0.15 m on every side, and not more than 0.15 m below or above its box. Surfaces,
  fronts and legs all count, because a receptacle's instance often covers only the visible part.

Class names are compared as in the detector: letter case, underscores and hyphens do not matter,
synonyms and kinds do ("table" is not correct for a coffee table, as in the metrics). Each instance
is judged alone: two instances on one object are both correct.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal, Protocol

from helios_core.name_rules import plain
from helios_core.types import ObjectInstance

from helios_eval.episodes.episode_record import Belief

Role = Literal["object", "start", "goal"]

OBJECT_MARGIN_M = 0.10
RECEPTACLE_MARGIN_M = 0.15


class TrueObject(Protocol):
    """Object or receptacle at its current pose, from the simulator."""

    @property
    def class_name(self) -> str: ...

    @property
    def center_m(self) -> Sequence[float]:
        """Centre of its box [3], world frame, metres."""
        ...

    @property
    def size_m(self) -> Sequence[float]:
        """Size of its box [3] before the turn by `yaw_rad`, metres."""
        ...

    @property
    def yaw_rad(self) -> float: ...


def judge_instances(
    objects: Sequence[ObjectInstance],
    things: Sequence[TrueObject],
    roles: Mapping[str, Role],
    step: int,
) -> list[Belief]:
    """Beliefs about the instances whose class has a role, in the order of `objects`.

    roles: class name -> role in the task. Instances of other classes are left out.
    """
    role_of: dict[str, Role] = {plain(name): role for name, role in roles.items()}
    by_class: dict[str, list[TrueObject]] = {}
    for thing in things:
        by_class.setdefault(plain(thing.class_name), []).append(thing)
    out = []
    for instance in objects:
        name = plain(instance.class_name)
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
                image_text_nats=instance.image_text_nats or 0.0,
            )
        )
    return out


def is_at(instance: ObjectInstance, thing: TrueObject, role: Role) -> bool:
    """True if the instance's centre lies in the grown box of `thing`; classes are not compared."""
    margin_m = OBJECT_MARGIN_M if role == "object" else RECEPTACLE_MARGIN_M
    dx, dy, dz = (float(a) - b for a, b in zip(instance.center_m, thing.center_m, strict=True))
    c, s = math.cos(thing.yaw_rad), math.sin(thing.yaw_rad)
    along = (c * dx + s * dy, c * dy - s * dx, dz)
    return all(
        abs(offset) <= size / 2 + margin_m for offset, size in zip(along, thing.size_m, strict=True)
    )
