"""Scoring and ranking of stored views for a new prompt, for a value layer and for places."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from helios_core import proto as pb
from helios_core.codec import embedding_from_proto, frame_id_to_proto
from helios_core.embedding_similarity import image_text_score
from helios_core.errors import Unavailable
from helios_core.name_rules import mentions_class
from helios_core.types import Embedding

from helios_map2d.layers.value_layers import Cone
from helios_map2d.view_memory.localization import Localization
from helios_map2d.view_memory.stored_views import SeenView

APART_M = 1.0  # two answers are at least this far apart, or differ in direction of view
TURNED = 0.5  # cosine of the least angle between different directions


@dataclass(frozen=True)
class Question:
    """Prompt with its text embedding; an image scores `clip(scale * cosine + offset, 0, 1)`."""

    prompt: str
    text: Embedding
    scale: float
    offset: float

    def score(self, image: Embedding) -> float:
        """Score of an image, 0 to 1."""
        return image_text_score(image, self.text, self.scale, self.offset)


def questions(prompts: Sequence[str], reply: pb.EmbedTextReply) -> list[Question]:
    """Prompts with the detector's embeddings. Raises Unavailable if some are missing."""
    if len(reply.embeddings) != len(prompts):
        raise Unavailable(
            f"{len(prompts)} prompts were to be embedded, {len(reply.embeddings)} were: the "
            "detector's scorer does not embed texts; start it with one that does"
        )
    if not (math.isfinite(reply.scale) and math.isfinite(reply.offset)):
        raise Unavailable(
            f"the detector's scorer has scale {reply.scale} and offset {reply.offset}, wanted "
            "finite numbers: look at the detector's log"
        )
    return [
        Question(prompt, embedding_from_proto(e), reply.scale, reply.offset)
        for prompt, e in zip(prompts, reply.embeddings, strict=True)
    ]


@dataclass(frozen=True)
class Answer:
    """Matching view. `class_name`: the detected class; empty if the scorer's model scored it."""

    view: SeenView
    score: float  # 0 to 1
    at_m: tuple[float, float]  # place of the detected object, or most likely place in the view
    class_name: str = ""


def scored(views: Sequence[SeenView], question: Question) -> list[tuple[SeenView, float]]:
    """Views embedded by the question's model, with their scores, in their order.

    Views of another model, or without an embedding, are not comparable and are skipped.
    """
    return [
        (v, question.score(v.embedding))
        for v in views
        if v.embedding is not None and v.embedding.model == question.text.model
    ]


def by_name(views: Sequence[SeenView], prompt: str) -> list[Answer]:
    """Views with a detected class that the prompt names, with the detector's scores."""
    return [
        Answer(v, s.score, (s.x_m, s.y_m), s.class_name)
        for v in views
        for s in v.named
        if mentions_class(prompt, s.class_name)
    ]


def as_layer(fits: Sequence[tuple[SeenView, float]]) -> list[tuple[Cone, float]]:
    """Cones and scores, as input of `EpochMap.set_layer`."""
    return [(view.cone, score) for view, score in fits]


def located(fits: Sequence[tuple[SeenView, float]]) -> list[Answer]:
    """Views, each with the most likely place of the object in it."""
    whereabouts = Localization(as_layer(fits))
    return [Answer(view, score, whereabouts.within(view.cone)) for view, score in fits]


def best_places(answers: Sequence[Answer], most: int) -> list[Answer]:
    """Best views, best first, with only one per place and direction of view."""
    out: list[Answer] = []
    for answer in sorted(answers, key=lambda a: -a.score):
        if len(out) == most:
            break
        if not any(_alike(answer, other) for other in out):
            out.append(answer)
    return out


def place_message(answer: Answer) -> pb.SeenPlace:
    """Message of an answer."""
    view, heading = answer.view, answer.view.cone.heading
    camera = pb.Pose2(
        x_m=view.cone.x_m, y_m=view.cone.y_m, yaw_rad=math.atan2(heading[1], heading[0])
    )
    return pb.SeenPlace(
        id=frame_id_to_proto(view.id),
        stamp_ns=view.stamp_ns,
        score=answer.score,
        camera=camera,
        x_m=answer.at_m[0],
        y_m=answer.at_m[1],
        jpeg=view.jpeg,
        class_name=answer.class_name,
    )


def _alike(one: Answer, other: Answer) -> bool:
    if one.class_name != other.class_name or math.dist(one.at_m, other.at_m) >= APART_M:
        return False
    (cx, cy), (dx, dy) = one.view.cone.heading, other.view.cone.heading
    return cx * dx + cy * dy > TURNED
