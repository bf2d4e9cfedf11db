"""Beliefs about the instances of a map: score, shape and description, computed once per change."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from helios_core.types import ObjectInstance
from helios_core.usual_sizes import (
    Extents,
    agreement,
    extents_of,
    usual_extents,
)
from numpy.typing import NDArray

from helios_objectmap.fusion.semantics import Score
from helios_objectmap.gaussians import GaussianStore
from helios_objectmap.instances.image_text import ImageTextScores, SectorScores, with_evidence
from helios_objectmap.instances.name_sightings import (
    NameErrors,
    NameSightings,
    evidence_share,
)
from helios_objectmap.instances.registry import InstanceRegistry
from helios_objectmap.instances.summary import (
    Belief,
    Shape,
    believed,
    describe,
    shape_of,
    sure_part,
    with_trust,
)
from helios_objectmap.searched_classes import SearchedClasses
from helios_objectmap.settings import ObjectMapSettings

MIN_GAUSSIANS = 5  # smaller instances are not reported


class InstanceBeliefs:
    """Beliefs about instances, by label.

    A computed belief stays until it is dropped. The owner drops the beliefs of instances that an
    update changes, that a view may show, and whose rows in the store get other numbers.
    """

    def __init__(
        self,
        settings: ObjectMapSettings,
        store: GaussianStore,
        registry: InstanceRegistry,
        classes: SearchedClasses,
        sightings: NameSightings,
        name_errors: NameErrors,
        image_text: ImageTextScores,
    ) -> None:
        self._settings, self._store, self._registry = settings, store, registry
        self._classes, self._sightings, self._name_errors = classes, sightings, name_errors
        self._image_text = image_text
        self._sectors: dict[int, SectorScores | None] = {}
        self._rises: dict[str, float] = {}  # class -> rise of its image-text scores
        self._beliefs: dict[int, Belief | None] = {}
        self._shapes: dict[int, Shape] = {}  # of the beliefs; they depend on no score
        self._described: dict[int, ObjectInstance | None] = {}

    def drop(self, labels: Iterable[int]) -> None:
        """Forget what was computed for instances that have changed."""
        labels = list(labels)
        for label in labels:
            self._described.pop(label, None)
        self.drop_rows(labels)

    def drop_rows(self, labels: Iterable[int]) -> None:
        """Forget the beliefs of instances whose rows got other numbers, or that a view may show.
        Their descriptions stay."""
        for label in labels:
            self._beliefs.pop(label, None)
            self._shapes.pop(label, None)
            self._sectors.pop(label, None)
        self._rises.clear()

    def drop_all(self) -> None:
        for known in (self._described, self._beliefs, self._shapes, self._sectors, self._rises):
            known.clear()

    def belief(self, label: int) -> Belief | None:
        """Belief that an instance is of its own class, without image-text scores; None if it is too
        small to be reported."""
        if label not in self._beliefs:
            self._beliefs[label] = self._new_belief(label)
        return self._beliefs[label]

    def described(self, label: int) -> ObjectInstance | None:
        """Description of an instance; None if it is too small to be reported."""
        if label not in self._described:
            self._described[label] = self._new_description(label)
        thing = self._described[label]
        nats = self.image_text_nats(label)
        if thing is None or nats is None:
            return thing
        now = with_evidence(Score(thing.class_score, thing.uncertainty, thing.score), nats)
        likely = thing.probabilities | {thing.class_name: now.class_score}
        rest = 1 - sum(p for name, p in likely.items() if name != "other")
        return replace(
            thing,
            score=now.psi,
            class_score=now.class_score,
            uncertainty=now.uncertainty,
            probabilities=likely | {"other": max(0.0, rest)},
            image_text_nats=nats,
        )

    def score(self, label: int) -> Score | None:
        """Score of an instance; None if it is too small to be reported."""
        belief = self.belief(label)
        if belief is None:
            return None
        return with_evidence(belief.score, self.image_text_nats(label) or 0.0)

    def image_text_nats(self, label: int) -> float | None:
        """Log-likelihood ratio of an instance's class by image-text scores; None if the scorer does
        not rate the class, or the instance is too small to be reported."""
        name = self._registry.records[label].class_name
        ignored = self._settings.image_text == "ignored" or not self._image_text.rates(name)
        if ignored or self.belief(label) is None:
            return None
        seen = self._seen_by_sector(label)
        if seen is None:
            return 0.0
        return self._image_text.log_likelihood_ratio(seen, name, self._rise(name))

    def _rise(self, class_name: str) -> float:
        """Rise of the image-text scores of views that show the class."""
        if class_name not in self._rises:
            things = (
                (belief.score.psi, seen)
                for label, record in self._registry.records.items()
                if record.class_name == class_name
                and (belief := self.belief(label)) is not None
                and (seen := self._seen_by_sector(label)) is not None
            )
            self._rises[class_name] = self._image_text.rise(class_name, things)
        return self._rises[class_name]

    def _seen_by_sector(self, label: int) -> SectorScores | None:
        if label not in self._sectors:
            rows = self._store.instances.rows_of(np.array([label]))
            name = self._registry.records[label].class_name
            self._sectors[label] = self._image_text.of(self._store.means, rows, name)
        return self._sectors[label]

    def box_threshold(self, label: int, mean: NDArray[np.floating]) -> float:
        """Probability above which a Gaussian of an instance belongs to its box; mean: [n]."""
        least = self._settings.named_from
        class_name = self._registry.records[label].class_name
        if self._settings.by_sides and not self._classes.is_receptacle(class_name):
            least = max(least, sure_part(mean))
        return least

    def _new_belief(self, label: int) -> Belief | None:
        store, s = self._store, self._settings
        rows = store.instances.rows_of(np.array([label]))
        if len(rows) < MIN_GAUSSIANS:
            return None
        class_name, names = self._registry.records[label].class_name, self._classes.names
        if class_name not in names:
            names.append(class_name)
        trust = self._trust(label)
        if s.look_alikes == "compared":
            trust *= self._name_share(label, rows)
        belief = self._believed(rows, class_name, names, trust)
        counted = trust
        if s.look_alikes == "sized":
            counted *= self._name_share(label, rows, self._shape(label, belief))
        if s.size_agreement != "off":
            counted *= self._size_agreement(label, belief)
        if counted == trust:
            return belief
        return with_trust(
            belief,
            self._store,
            class_name,
            s.prior_concentration,
            self._classes.prior_classes,
            s.alpha_cs,
            counted,
        )

    def _believed(
        self, rows: NDArray[np.integer], class_name: str, names: list[str], trust: float
    ) -> Belief:
        s = self._settings
        return believed(
            self._store,
            rows,
            class_name,
            names,
            s.prior_concentration,
            self._classes.prior_classes,
            s.alpha_cs,
            trust,
        )

    def _trust(self, label: int) -> float:
        """Estimated share of true detections of an instance, learnt from earlier detections of its
        class."""
        trust = self._settings.detector_trust
        return (
            1.0
            if trust == "full"
            else self._registry.true_detection_share(label, trust == "class-distance")
        )

    def _name_share(
        self, label: int, rows: NDArray[np.integer], shape: Shape | None = None
    ) -> float:
        """Share of an instance's evidence that counts, by the other names that it was called by.
        shape: with it, other names that it does not fit count less."""
        name = self._registry.records[label].class_name
        rates = self._sightings.rates(self._store.means, rows, name, self._settings.side_views)
        if rates is None:
            return 1.0
        if shape is None:
            return evidence_share(rates.probability(name, self._name_errors))
        measured = self._measured(shape)
        return evidence_share(
            rates.probability(
                name,
                self._name_errors,
                lambda other: agreement(other, measured[0], 0.0, measured[1]),
            )
        )

    def _size_agreement(self, label: int, belief: Belief) -> float:
        """Likelihood, in (0, 1], of the measured size of an instance, given its class."""
        record = self._registry.records[label]
        if usual_extents(record.class_name) is None:
            return 1.0
        measured_m, top_m = self._measured(self._shape(label, belief))
        views = record.views if self._settings.size_agreement == "on" else 0.0
        return agreement(record.class_name, measured_m, views, top_m)

    def _measured(self, shape: Shape) -> tuple[Extents, float | None]:
        """Extents of a shape, and the height of its top above the floor; None: not known."""
        extents_m = extents_of(shape.outline_m, float(shape.high_m[2] - shape.low_m[2]))
        floor_m = self._settings.floor_m
        return extents_m, None if floor_m is None else float(shape.high_m[2]) - floor_m

    def _shape(self, label: int, belief: Belief) -> Shape:
        if label not in self._shapes:
            least = self.box_threshold(label, belief.mean)
            self._shapes[label] = shape_of(self._store.means, belief, least)
        return self._shapes[label]

    def _new_description(self, label: int) -> ObjectInstance | None:
        belief = self.belief(label)
        if belief is None:
            return None
        return describe(label, self._registry.records[label], self._shape(label, belief), belief)
