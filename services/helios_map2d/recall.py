"""Asking past views a new question: a value layer of it, and where its answer was seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from helios_core import proto as pb
from helios_core.codec import embedding_from_proto, frame_id_to_proto
from helios_core.embeddings import fit
from helios_core.errors import Unavailable
from helios_core.types import Embedding

from helios_map2d.memory import SeenView
from helios_map2d.value import Cone

APART_M = 1.0  # two answers lie at least this far apart, or look in other directions
TURNED = 0.5  # cosine of the angle from which directions are other ones


@dataclass(frozen=True)
class Question:
    """A prompt as the scorer's model sees it: `clip(scale * cosine + offset, 0, 1)` of an image."""

    prompt: str
    text: Embedding
    scale: float
    offset: float

    def score(self, view: SeenView) -> float:
        """How well a view fits, 0 to 1."""
        return fit(view.embedding, self.text, self.scale, self.offset)


def questions(prompts: Sequence[str], reply: pb.EmbedTextReply) -> list[Question]:
    """The prompts as the detector embedded them. Raises Unavailable when some are missing."""
    if len(reply.embeddings) != len(prompts):
        raise Unavailable(
            f"{len(prompts)} prompts were to be embedded, {len(reply.embeddings)} were: the "
            "detector's scorer does not embed texts; start it with one that does"
        )
    return [
        Question(prompt, embedding_from_proto(e), reply.scale, reply.offset)
        for prompt, e in zip(prompts, reply.embeddings, strict=True)
    ]


def scored(views: Sequence[SeenView], question: Question) -> list[tuple[SeenView, float]]:
    """The views of the question's model with their scores, in their order.

    What another model has seen cannot be compared and is left out.
    """
    return [(v, question.score(v)) for v in views if v.embedding.model == question.text.model]


def as_layer(answers: Sequence[tuple[SeenView, float]]) -> list[tuple[Cone, float]]:
    """What `MapState.set_layer` makes a value layer of."""
    return [(view.cone, score) for view, score in answers]


def best_places(
    answers: Sequence[tuple[SeenView, float]], most: int
) -> list[tuple[SeenView, float]]:
    """The best views, best first, without those that show the same place from the same side."""
    out: list[tuple[SeenView, float]] = []
    for view, score in sorted(answers, key=lambda a: -a[1]):
        if len(out) == most:
            break
        if not any(_alike(view, other) for other, _ in out):
            out.append((view, score))
    return out


def place_message(view: SeenView, score: float) -> pb.SeenPlace:
    """An answer as it travels."""
    x_m, y_m = view.middle_m
    heading = view.cone.heading
    camera = pb.Pose2(
        x_m=view.cone.x_m, y_m=view.cone.y_m, yaw_rad=math.atan2(heading[1], heading[0])
    )
    return pb.SeenPlace(
        id=frame_id_to_proto(view.id), stamp_ns=view.stamp_ns, score=score, camera=camera,
        x_m=x_m, y_m=y_m, jpeg=view.jpeg,
    )  # fmt: skip


def _alike(one: SeenView, other: SeenView) -> bool:
    (ax, ay), (bx, by) = one.middle_m, other.middle_m
    (cx, cy), (dx, dy) = one.cone.heading, other.cone.heading
    return math.hypot(ax - bx, ay - by) < APART_M and cx * dx + cy * dy > TURNED
