"""Conversion of SearchContext and ObjectInstance to protobuf messages and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.types import ObjectInstance, Role, SearchClass, SearchContext

MOST_CLASSES, MOST_LAYERS, MOST_CHARACTERS = 128, 16, 300  # each layer is a map by itself
MOST_SYNONYMS, MOST_PROMPT_CHARACTERS, MOST_ALSO = 64, 2000, 1024


def vector_to_proto(v: Sequence[float] | NDArray[np.float64]) -> pb.Vector3:
    """Message of x, y, z."""
    return pb.Vector3(x=float(v[0]), y=float(v[1]), z=float(v[2]))


def vector_from_proto(v: pb.Vector3) -> NDArray[np.float64]:
    """Array [3] of a message; numbers may be NaN or infinite."""
    return np.array([v.x, v.y, v.z])


def context_to_proto(context: SearchContext) -> pb.SearchContext:
    """Message of a search context; the inverse of `context_from_proto`."""
    return pb.SearchContext(
        id=context.id,
        classes=[
            pb.SearchClass(name=c.name, role=c.role, threshold=c.threshold, synonyms=c.synonyms)
            for c in context.classes
        ],
        prompts=context.prompts,
        also=context.also,
        class_prompts=context.class_prompts,
    )


def context_from_proto(context: pb.SearchContext) -> SearchContext:
    """SearchContext.

    Raises InvalidInput on too many or too long names, a class without a name, an unknown role, or a
    threshold outside 0 to 1.
    """
    _check_sizes(context)
    roles = {r.value for r in Role}
    for c in context.classes:
        if c.role not in roles or not c.name or not 0 <= c.threshold <= 1:
            raise InvalidInput(
                f"search class {c.name!r} has role {c.role!r} and threshold {c.threshold}; wanted "
                f"a name, a role of {', '.join(sorted(roles))} and a threshold of 0 to 1"
            )
    return SearchContext(
        id=context.id,
        classes=tuple(
            SearchClass(c.name, Role(c.role), c.threshold, tuple(c.synonyms))
            for c in context.classes
        ),
        prompts=dict(context.prompts),
        also=tuple(context.also),
        class_prompts=dict(context.class_prompts),
    )


def _check_sizes(context: pb.SearchContext) -> None:
    """Raises InvalidInput on too many or too long names and prompts."""
    if len(context.classes) > MOST_CLASSES or len(context.prompts) > MOST_LAYERS:
        raise InvalidInput(
            f"the search context asks for {len(context.classes)} classes and "
            f"{len(context.prompts)} value layers; ask for at most {MOST_CLASSES} and {MOST_LAYERS}"
        )
    if (most := max((len(c.synonyms) for c in context.classes), default=0)) > MOST_SYNONYMS:
        raise InvalidInput(
            f"the search context gives a class {most} synonyms; give at most {MOST_SYNONYMS}"
        )
    if len(context.also) > MOST_ALSO:
        raise InvalidInput(
            f"the search context asks for {len(context.also)} other names; ask for at most "
            f"{MOST_ALSO}"
        )
    if len(context.class_prompts) > MOST_CLASSES:
        raise InvalidInput(
            f"the search context has prompts for {len(context.class_prompts)} classes; send at "
            f"most {MOST_CLASSES}"
        )
    prompts = (*context.prompts.values(), *context.class_prompts.values())
    if (longest := max(map(len, prompts), default=0)) > MOST_PROMPT_CHARACTERS:
        raise InvalidInput(
            f"the search context holds a prompt of {longest} characters; send at most "
            f"{MOST_PROMPT_CHARACTERS}"
        )
    synonyms = (s for c in context.classes for s in c.synonyms)
    classes = (c.name for c in context.classes)
    names = (
        context.id,
        *classes,
        *synonyms,
        *context.prompts,
        *context.class_prompts,
        *context.also,
    )
    if (longest := max(map(len, names))) > MOST_CHARACTERS:
        raise InvalidInput(
            f"the search context holds a name of {longest} characters; send at most "
            f"{MOST_CHARACTERS}"
        )


def object_to_proto(instance: ObjectInstance) -> pb.ObjectInstance:
    """Message of an instance; its outline becomes x, y, x, y, …"""
    return pb.ObjectInstance(
        id=instance.id,
        class_name=instance.class_name,
        center_m=vector_to_proto(instance.center_m),
        size_m=vector_to_proto(instance.size_m),
        score=instance.score,
        class_score=instance.class_score,
        uncertainty=instance.uncertainty,
        views=instance.views,
        gaussians=instance.gaussians,
        probabilities=instance.probabilities,
        top_m=instance.top_m,
        outline_m=instance.outline_m.ravel().tolist(),
        detection_rate=instance.detection_rate,
        image_text_nats=instance.image_text_nats,
        relocalised=instance.relocalised,
    )


def object_from_proto(instance: pb.ObjectInstance) -> ObjectInstance:
    """ObjectInstance. Raises InvalidInput on an outline with an odd number of coordinates."""
    if len(instance.outline_m) % 2:
        raise InvalidInput(
            f"the outline of object {instance.id} has {len(instance.outline_m)} numbers; send x "
            "and y of each point"
        )
    rated = instance.HasField("image_text_nats")
    return ObjectInstance(
        id=instance.id,
        class_name=instance.class_name,
        center_m=vector_from_proto(instance.center_m),
        size_m=vector_from_proto(instance.size_m),
        score=instance.score,
        class_score=instance.class_score,
        uncertainty=instance.uncertainty,
        views=instance.views,
        gaussians=instance.gaussians,
        probabilities=dict(instance.probabilities),
        top_m=instance.top_m,
        outline_m=np.array(instance.outline_m, float).reshape(-1, 2),
        detection_rate=instance.detection_rate,
        image_text_nats=instance.image_text_nats if rated else None,
        relocalised=instance.relocalised,
    )
