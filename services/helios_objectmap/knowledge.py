"""What the map knows, and what it can be asked: objects, what-ifs, pictures, files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.types import ObjectInstance, Role, SearchContext
from numpy.typing import NDArray

from helios_objectmap.answers import information_gain
from helios_objectmap.answers.detail import Grasp, grasp
from helios_objectmap.answers.information_gain import Expected, Member, Rates
from helios_objectmap.answers.objects import (
    Belief,
    InstanceGaussians,
    Shape,
    believed,
    describe,
    gaussians_of,
    shape_of,
    sure_part,
)
from helios_objectmap.answers.sizes import agreement, extents_of
from helios_objectmap.evidence import sides
from helios_objectmap.evidence.dirichlet import marginal
from helios_objectmap.files.mapfile import Memory
from helios_objectmap.instances.registry import InstanceRegistry, Moment
from helios_objectmap.rendering import picture
from helios_objectmap.rendering.back_ends import back_end
from helios_objectmap.rendering.renderer import FAR_M, Projection
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.store.gaussians import NO_INSTANCE, GaussianStore
from helios_objectmap.store.viewpoints import Viewpoints
from helios_objectmap.view import View

SEEN_BEYOND_M = 1.0  # Gaussians this far beyond the depth that is used still cover what is behind
HALF = 0.5


class Knowledge:
    """The state of a map with its answers. `ObjectMap` changes it."""

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._settings = settings
        self._back_end = back_end(settings.renderer)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._store = GaussianStore(self._sectors)
        self._registry = InstanceRegistry()
        self._viewpoints = self.no_viewpoints()
        self._context: SearchContext | None = None
        self._roles: dict[str, Role] = {}
        self._updates = 0
        self._described: dict[int, ObjectInstance | None] = {}  # None: too small to be reported

    def __len__(self) -> int:
        return len(self._store)

    def nearest_object(self, point_m: NDArray[np.float64], within_m: float) -> int | None:
        """Id of the nearest instance that is no receptacle, or None where none is that near."""
        near = [
            (float(np.linalg.norm(o.center_m - point_m)), o.id)
            for o in self.objects()
            if not self._is_receptacle(o.class_name)
        ]
        distance, label = min(near, default=(np.inf, NO_INSTANCE))
        return label if distance <= within_m else None

    def objects(self) -> tuple[ObjectInstance, ...]:
        """All instances with enough Gaussians, by id."""
        known = self._described
        for label in self._registry.records.keys() - known.keys():
            known[label] = self._describe(label)
        return tuple(o for _, o in sorted(known.items()) if o is not None)

    def class_of(self, instance_id: int) -> str:
        """Class of an instance, "" where there is no such one."""
        record = self._registry.records.get(instance_id)
        return record.class_name if record is not None else ""

    def history(self, instance_id: int) -> tuple[Moment, ...]:
        """How the belief in an instance went, oldest first; empty where there is no such one."""
        record = self._registry.records.get(instance_id)
        return tuple(record.history) if record is not None else ()

    def what_if(
        self,
        instance_id: int,
        class_name: str,
        views: Sequence[View],
        other_share: float | None = None,
    ) -> tuple[list[Expected], Expected] | None:
        """Score and information gain if views showed an instance as a class (eq. 11 and 12).

        views: full-resolution cameras with poses. other_share: of what they show, what speaks for
        "other"; None for the setting. Returns the outcome of each view alone and of all together,
        or None where there is no such instance or class.
        """
        store, s = self._store, self._settings
        rows = store.instances.rows_of(np.array([instance_id]))
        if not len(rows) or class_name not in store.class_names:
            return None
        belief = None
        if class_name == self._registry.records[instance_id].class_name:
            belief = self._belief(instance_id)
        column = store.class_names.index(class_name)
        columns = self._columns if column in self._columns else [*self._columns, column]
        if other_share is None:
            other_share = HALF if s.assumption == "50-50" else 0.0
        by_sides = s.by_sides
        member = Member(
            store.means[rows],
            store.radius_m[rows],
            store.opacity[rows],
            store.positive[rows][:, columns],
            store.asked[rows, column],
            store.votes[rows, column, :, 1] if by_sides else None,
        )
        return information_gain.what_if(
            self._back_end,
            member,
            columns.index(column),
            [view.strided(s.stride_px) for view in views],
            Rates(
                s.prior_concentration,
                s.alpha_side if by_sides else s.alpha_cpa,
                s.alpha_cs,
                other_share,
                s.prior_classes,
                belief.trust if belief is not None else 1.0,
                s.side_views,
            ),
            s.max_depth_m,
        )

    def gaussians(self, instance_id: int | None = None) -> InstanceGaussians:
        """Copies of the Gaussians of an instance, or of all instances."""
        if instance_id is None:
            rows = np.flatnonzero(self._store.instance != NO_INSTANCE)
        else:
            rows = self._store.instances.rows_of(np.array([instance_id]))
        return gaussians_of(
            self._store, rows, self._settings.prior_concentration, self._settings.prior_classes
        )

    def render(self, view: View, layer: str, class_name: str) -> bytes:
        """PNG of a layer as a camera sees it; RGB, or for depth uint16 millimetres.

        layer: one of `picture.LAYERS`; the last two are of a class. Raises InvalidInput.
        """
        store, prior = self._store, self._settings.prior_concentration
        projection = self._project(view, FAR_M)
        rows = projection.rows
        if layer == "color":
            return picture.png(picture.color(projection, store.color[rows]))
        if layer == "depth":
            return picture.png(picture.depth_mm(projection))
        if layer not in picture.LAYERS or class_name not in store.class_names:
            raise InvalidInput(
                f"no picture of layer {layer!r} and class {class_name!r}; wanted one of "
                f"{', '.join(picture.LAYERS)}, and of {', '.join(store.class_names) or 'no class'}"
            )
        column = store.class_names.index(class_name)
        mean, deviation = marginal(
            store.positive[rows, column], store.asked[rows, column], prior, self._n_classes
        )
        if layer == "probability":
            return picture.png(picture.belief(projection, np.asarray(mean), 1.0))
        return picture.png(picture.belief(projection, deviation, picture.MOST_UNCERTAIN))

    def grasp(self, instance_id: int) -> Grasp | None:
        """Points and box of the believed part of an instance; None where there is no such one."""
        store = self._store
        rows = store.instances.rows_of(np.array([instance_id]))
        if not len(rows):
            return None
        column = store.class_names.index(self._registry.records[instance_id].class_name)
        mean, _ = marginal(
            store.positive[rows, column], store.asked[rows, column],
            self._settings.prior_concentration, self._n_classes,
        )  # fmt: skip
        own = rows[mean > self._least(instance_id, mean)]
        return grasp(store.means[own if len(own) else rows])

    # On disk ------------------------------------------------------------------------------------

    def memory(self) -> Memory:
        """All that is known; its parts are the map's own, not copies."""
        return Memory(self._store, self._registry, self._viewpoints, self._roles, self._updates)

    def recall(self, memory: Memory) -> None:
        """Know what a file holds, and nothing else.

        All evidence stays as it is, however it was counted. Votes by sides are forgotten where this
        map counts views; where it counts sides and the file has no votes, all sides are untold.
        """
        self.reset()
        self._store, self._registry = memory.store, memory.registry
        self._store.keep_votes(self._sectors)
        self._viewpoints, self._roles = memory.viewpoints, memory.roles
        self._updates = memory.updates

    def no_viewpoints(self) -> Viewpoints:
        """Empty ones, as this map's settings want them."""
        return Viewpoints(self._settings.viewpoint_moved_m, self._settings.viewpoint_turned_rad)

    # Parts ----------------------------------------------------------------------------------------

    @property
    def _sectors(self) -> int:
        """Around each Gaussian, of which votes are kept."""
        return sides.SECTORS if self._settings.by_sides else 0

    @property
    def _columns(self) -> list[int]:
        """Of the context's classes in the store."""
        return [self._store.class_names.index(name) for name in self._names]

    @property
    def _names(self) -> list[str]:
        return [c.name for c in self._context.distinct()] if self._context is not None else []

    @property
    def _n_classes(self) -> int:
        """Classes that the prior speaks of, "other" included."""
        return max(len(self._names) + 1, self._settings.prior_classes)

    def _project(
        self, view: View, far_m: float | None = None, rows: NDArray[np.int32] | None = None
    ) -> Projection:
        """What a view shows of some rows, default all."""
        store = self._store
        far_m = self._settings.max_depth_m + SEEN_BEYOND_M if far_m is None else far_m
        rows = store.seen_by(view, far_m) if rows is None else rows
        return self._back_end(store.means, store.radius_m, store.opacity, view, rows, far_m)

    def _is_receptacle(self, class_name: str) -> bool:
        return self._roles[class_name].is_receptacle

    def _voxel_m(self, class_name: str) -> float:
        s = self._settings
        return s.receptacle_voxel_m if self._is_receptacle(class_name) else s.object_voxel_m

    def _belief(self, label: int) -> Belief | None:
        """In an instance for its own class; None where it is too small to be reported."""
        store, s = self._store, self._settings
        rows = store.instances.rows_of(np.array([label]))
        if len(rows) < s.min_gaussians:
            return None
        class_name, names = self._registry.records[label].class_name, list(self._names)
        if class_name not in names:
            names.append(class_name)
        trust = self._trust(label)
        belief = self._believed(rows, class_name, names, trust)
        if s.size_agreement == "off":
            return belief
        return self._believed(rows, class_name, names, trust * self._size_agreement(label, belief))

    def _believed(
        self, rows: NDArray[np.integer], class_name: str, names: list[str], trust: float
    ) -> Belief:
        s = self._settings
        return believed(
            self._store, rows, class_name, names, s.prior_concentration, self._n_classes,
            s.alpha_cs, trust,
        )  # fmt: skip

    def _trust(self, label: int) -> float:
        """Share of the detections of an instance that is true by what became of such ones."""
        trust = self._settings.detector_trust
        return 1.0 if trust == "full" else self._registry.trust(label, trust == "class-distance")

    def _size_agreement(self, label: int, belief: Belief) -> float:
        """How well what was seen of an instance fits what its class usually measures."""
        s, record = self._settings, self._registry.records[label]
        shape = self._shape(label, belief)
        measured_m = extents_of(shape.outline_m, float(shape.high_m[2] - shape.low_m[2]))
        top_m = None if s.floor_m is None else float(shape.high_m[2]) - s.floor_m
        views = record.views if s.size_agreement == "on" else 0.0
        return agreement(record.class_name, measured_m, views, top_m)

    def _shape(self, label: int, belief: Belief) -> Shape:
        return shape_of(self._store.means, belief, self._least(label, belief.mean))

    def _least(self, label: int, mean: NDArray[np.floating]) -> float:
        """Probability from which a Gaussian of an instance is part of its box; mean: [n]."""
        least = self._settings.named_from
        if self._settings.by_sides and not self._is_receptacle(self.class_of(label)):
            least = max(least, sure_part(mean))
        return least

    def _describe(self, label: int) -> ObjectInstance | None:
        belief = self._belief(label)
        if belief is None:
            return None
        shape = self._shape(label, belief)
        return describe(label, self._registry.records[label], shape, belief)
