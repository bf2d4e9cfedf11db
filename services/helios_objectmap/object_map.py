"""Object map: updates from observations, and queries about its instances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.types import ObjectInstance, Observation, Role, SearchContext
from numpy.typing import NDArray

from helios_objectmap import export
from helios_objectmap.camera import View
from helios_objectmap.fusion import geometry, viewing_sectors
from helios_objectmap.fusion.geometry import compare_with_depth, reobserved
from helios_objectmap.fusion.label_image import OTHER_LABEL, LabelImage, read, without_held
from helios_objectmap.fusion.semantics import accumulate, marginal, most_likely_columns
from helios_objectmap.fusion.view_history import PastViews
from helios_objectmap.gaussians import NO_INSTANCE, OTHER, GaussianStore, InstanceGaussians, surplus
from helios_objectmap.instances import information_gain
from helios_objectmap.instances.furniture import is_furniture
from helios_objectmap.instances.information_gain import (
    EvidenceParameters,
    Expected,
    InstanceEvidence,
)
from helios_objectmap.instances.name_sightings import NameSightings
from helios_objectmap.instances.registry import InstanceRegistry, Moment
from helios_objectmap.instances.size_prior import agreement, extents_of
from helios_objectmap.instances.summary import (
    Belief,
    Grasp,
    Shape,
    believed,
    describe,
    gaussians_of,
    grasp,
    seen_area_m2,
    shape_of,
    sure_part,
)
from helios_objectmap.persistence import MapContent
from helios_objectmap.rendering.back_ends import back_end
from helios_objectmap.rendering.renderer_interface import FAR_M, Projection, Rendering
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.viewpoint_weights import NEVER, ViewpointMatch, Viewpoints

SEEN_BEYOND_M = 1.0  # margin beyond max_depth_m: Gaussians within it still occlude
HELD_OBJECT_M = 1.0  # while the gripper holds an object, nearer pixels of objects belong to it
OPACITY = 0.99  # of a new Gaussian
RADIUS_PX = 1.0  # standard deviation of a new Gaussian in the image
CARVE_VIEWS = 2.0  # distinct views through a Gaussian that remove it
MIN_GAUSSIANS = 5  # smaller instances are not reported
HALF = 0.5
WHOLE = 0.999  # sum of float32 shares from which a view counts as whole


@dataclass(frozen=True)
class UpdateReport:
    """Effect of one observation on the map, in numbers of Gaussians."""

    created: int
    carved: int
    in_view: int
    fused: int  # received evidence; 0 from a viewpoint that has counted already
    total: int


class ObjectMap:
    """Sparse 3D Gaussian map of the objects of interest. Not thread-safe: the owner locks.

    The cost of an update depends on the Gaussians in view, not on the size of the map.
    """

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._settings = settings
        self._back_end = back_end(settings.renderer)
        self.reset()

    def reset(self) -> None:
        """Delete all content."""
        self._store = GaussianStore(self._sectors)
        self._registry = InstanceRegistry()
        self._viewpoints = self.empty_viewpoints()
        self._context: SearchContext | None = None
        self._roles: dict[str, Role] = {}
        self._past = PastViews()
        self._sightings = NameSightings()
        self._beliefs: dict[int, Belief | None] = {}  # while no row is renumbered
        self._updates = 0
        self._described: dict[int, ObjectInstance | None] = {}  # None: too small to be reported

    def __len__(self) -> int:
        return len(self._store)

    # Updates ----------------------------------------------------------------------------------

    def set_context(self, context: SearchContext) -> None:
        """Search for the classes of a context from now on; the evidence for other classes stays."""
        if context == self._context:
            return
        store = self._store
        groups = {r.group for r in self._registry.records.values()}
        voxels = {g.class_name: self._voxel_m(g.class_name) for g in groups}
        self._context = context
        for c in context.distinct():
            store.column(c.name)
            self._roles.pop(c.name, None)  # most recently searched classes at the end
            self._roles[c.name] = c.role
        self._forget_classes(
            list(self._roles)[: -max(self._settings.max_classes, len(self._names))]
        )
        for group in sorted(g for g in groups if g.class_name in self._roles):
            voxel_m = self._voxel_m(group.class_name)
            if voxel_m != voxels[group.class_name]:
                self._registry.recluster(store, group, voxel_m)
        self._believe(np.arange(len(store)))
        self._drop_all()

    def update(
        self, observation: Observation, context: SearchContext, held: str = ""
    ) -> UpdateReport:
        """Integrate one observation made for a context. held: class of the object that the robot
        holds."""
        self.set_context(context)
        s, store = self._settings, self._store
        reading = without_held(
            read(observation, context, s.stride_px, s.min_depth_m, s.max_depth_m),
            context, held, HELD_OBJECT_M,
        )  # fmt: skip
        look = self._viewpoints.locate(reading.view.T_world_cam)
        if s.look_alikes == "compared" and self._is_new(look):
            detections = (*observation.detections, *observation.others)
            self._sightings.note(reading, s.stride_px, detections)
        projection = self._project(reading.view)
        gone = np.empty(0, np.int32)
        if s.creation_rule != "paper":
            projection, gone = self._carve(projection, reading, look)
        rendering = projection.render()

        created_mask = self._creation_mask(reading, rendering)
        created = self._create(reading, created_mask)
        if created:  # only the new Gaussians need a projection
            new = np.arange(len(store) - created, len(store), dtype=np.int32)
            self._add_hindsight_votes(new)
            projection = projection.renewed(gone[:0], self._project(reading.view, rows=new))
        seen = reobserved(reading.depth_m, rendering, created_mask)
        labels = np.where(seen, reading.labels, -1).astype(np.int32)
        eye_m = reading.view.T_world_cam[:3, 3]
        weights = self._hindsight_weights(look)
        fused = self._fuse(projection, labels, look, eye_m, observation.frame.stamp_ns)
        if weights is not None:
            self._past.note(reading, self._names, weights)
        self._updates += 1
        store.remove(gone)
        if len(gone):
            self._beliefs.clear()
        self._remove(surplus(store.class_column, store.last_seen_update, s.max_gaussians))
        return UpdateReport(created, len(gone), len(projection.rows), fused, len(store))

    def retire(self, instance_id: int) -> int:
        """Remove an object that was picked. Returns the number of Gaussians removed, 0 if unknown.

        All Gaussians in its box go with it, except those of receptacles.
        """
        store = self._store
        member = store.instances.rows_of(np.array([instance_id]))
        if not len(member):
            return 0
        low, high = store.means[member].min(axis=0), store.means[member].max(axis=0)
        near = store.blocks.near(store.means[member], float((high - low).max()))
        inside = ((store.means[near] >= low) & (store.means[near] <= high)).all(axis=1)
        receptacles = [i for i, name in enumerate(store.class_names) if self._is_receptacle(name)]
        inside &= ~np.isin(store.class_column[near], receptacles)
        gone = np.union1d(member, near[inside])
        self._sightings.forget_at(store.means[member])
        self._remove(gone)
        self._past.forget(lambda name: not self._is_receptacle(name))
        return len(gone)

    # Queries ----------------------------------------------------------------------------------

    def nearest_object(self, point_m: NDArray[np.float64], within_m: float) -> int | None:
        """Id of the nearest instance that is not a receptacle; None if none is that near."""
        near = [
            (float(np.linalg.norm(o.center_m - point_m)), o.id)
            for o in self.objects()
            if not self._is_receptacle(o.class_name)
        ]
        distance, label = min(near, default=(np.inf, NO_INSTANCE))
        return label if distance <= within_m else None

    def objects(self) -> tuple[ObjectInstance, ...]:
        """All instances with enough Gaussians, by id."""
        known, registry = self._described, self._registry
        for label in registry.records.keys() - known.keys():
            known[label] = self._describe(label)
        return tuple(
            o for label, o in sorted(known.items())
            if o is not None and not registry.is_beside_core(label)
        )  # fmt: skip

    def class_of(self, instance_id: int) -> str:
        """Class of an instance; "" if the id is unknown."""
        record = self._registry.records.get(instance_id)
        return record.class_name if record is not None else ""

    def history(self, instance_id: int) -> tuple[Moment, ...]:
        """Scores of an instance over time, oldest first; empty if the id is unknown."""
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

        views: full-resolution cameras with poses. other_share: share of their evidence that goes to
        "other"; None for the setting. Returns the outcome of each view alone and of all together,
        or None if there is no such instance or class.
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
        member = InstanceEvidence(
            store.means[rows],
            store.radius_m[rows],
            store.opacity[rows],
            store.class_evidence[rows][:, columns],
            store.total_evidence[rows, column],
            store.votes[rows, column, :, 1] if by_sides else None,
        )
        return information_gain.what_if(
            self._back_end,
            member,
            columns.index(column),
            [view.strided(s.stride_px) for view in views],
            EvidenceParameters(
                s.prior_concentration,
                s.alpha_side if by_sides else s.alpha_cpa,
                s.alpha_cs,
                other_share,
                s.prior_classes,
                belief.trust if belief is not None else 1.0,
                s.side_views,
            ),
            s.max_depth_m,
            s.expected_label == "rendered",
        )

    def seen_area_m2(self, instance_id: int) -> float:
        """Surface of an instance seen so far; 0 if there is no such instance."""
        rows = self._store.instances.rows_of(np.array([instance_id]))
        return seen_area_m2(self._store.means[rows])

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
        """PNG of a layer seen by a camera: RGB, or uint16 millimetres for depth.

        layer: one of `export.LAYERS`; the last two need a class. Raises InvalidInput.
        """
        store, prior = self._store, self._settings.prior_concentration
        projection = self._project(view, FAR_M)
        rows = projection.rows
        if layer == "color":
            return export.png(export.color(projection, store.color[rows]))
        if layer == "depth":
            return export.png(export.depth_mm(projection))
        if layer not in export.LAYERS or class_name not in store.class_names:
            raise InvalidInput(
                f"no picture of layer {layer!r} and class {class_name!r}; wanted one of "
                f"{', '.join(export.LAYERS)}, and of {', '.join(store.class_names) or 'no class'}"
            )
        column = store.class_names.index(class_name)
        mean, deviation = marginal(
            store.class_evidence[rows, column],
            store.total_evidence[rows, column],
            prior,
            self._n_classes,
        )
        if layer == "probability":
            return export.png(export.belief(projection, np.asarray(mean), 1.0))
        return export.png(export.belief(projection, deviation, export.MOST_UNCERTAIN))

    def grasp(self, instance_id: int) -> Grasp | None:
        """Points and grasp box of the Gaussians of an instance that have its class; None if
        unknown."""
        store = self._store
        rows = store.instances.rows_of(np.array([instance_id]))
        if not len(rows):
            return None
        column = store.class_names.index(self._registry.records[instance_id].class_name)
        mean, _ = marginal(
            store.class_evidence[rows, column], store.total_evidence[rows, column],
            self._settings.prior_concentration, self._n_classes,
        )  # fmt: skip
        own = rows[mean > self._box_threshold(instance_id, mean)]
        return grasp(store.means[own if len(own) else rows])

    # On disk ----------------------------------------------------------------------------------

    def content(self) -> MapContent:
        """Content of the map; its parts are the map's own objects, not copies."""
        return MapContent(self._store, self._registry, self._viewpoints, self._roles, self._updates)

    def load_content(self, content: MapContent) -> None:
        """Replace the content of the map with that of a file.

        The evidence stays as the file has it. A map that counts views drops votes by viewing
        sector. A map that counts sectors starts with empty ones if the file has no votes. The
        instances are clustered with the voxels of this map, which may differ from the file's.
        """
        self.reset()
        self._store, self._registry = content.store, content.registry
        self._store.keep_votes(self._sectors)
        self._viewpoints, self._roles = content.viewpoints, content.roles
        self._updates = content.updates
        for group in sorted({r.group for r in self._registry.records.values()}):
            self._registry.recluster(self._store, group, self._voxel_m(group.class_name))

    def empty_viewpoints(self) -> Viewpoints:
        """An empty `Viewpoints`."""
        return Viewpoints()

    # Parts of an update -----------------------------------------------------------------------

    def _forget_classes(self, names: list[str]) -> None:
        """Remove all evidence for some classes, and their instances."""
        store = self._store
        if not names:
            return
        columns = [store.class_names.index(name) for name in names]
        rows = np.flatnonzero(np.isin(store.class_column, columns))
        self._registry.leave(store, rows, self._voxel_m)
        store.class_column[rows] = OTHER
        self._join(rows)
        store.drop_columns(names)
        for name in names:
            self._viewpoints.forget(name)
            self._registry.ended.pop(name, None)
            del self._roles[name]

    def _carve(
        self, projection: Projection, reading: LabelImage, look: ViewpointMatch
    ) -> tuple[Projection, NDArray[np.int32]]:
        """Free-space carving: fade the Gaussians that a view sees through, restore those it sees.

        Returns the updated projection, and the rows to remove, which enough views saw through.
        """
        store = self._store
        seen = compare_with_depth(projection, reading.depth_m)
        there = seen.there[store.seen_through_views[projection.rows[seen.there]] > 0]
        restored = projection.rows[there]
        store.seen_through_views[restored], store.seen_through_viewpoint[restored] = 0, NEVER
        through = projection.rows[seen.through]
        share = self._viewpoints.difference_from(look, store.seen_through_viewpoint[through])
        counted = through[share > 0]
        store.seen_through_views[counted] += share[share > 0]
        store.seen_through_viewpoint[counted] = look.viewpoint
        changed = np.concatenate([restored, counted])
        if not len(changed):
            return projection, changed
        left = np.maximum(1 - store.seen_through_views[changed] / CARVE_VIEWS, 0)
        store.opacity[changed] = OPACITY * left
        is_gone = store.seen_through_views[changed] >= WHOLE * CARVE_VIEWS
        gone, stays = changed[is_gone], changed[~is_gone]
        self._registry.leave(store, gone, self._voxel_m)
        store.class_column[gone] = OTHER
        return projection.renewed(
            np.concatenate([there, seen.through[share > 0]]),
            self._project(reading.view, rows=stays),
        ), gone

    def _creation_mask(self, reading: LabelImage, rendering: Rendering) -> NDArray[np.bool_]:
        detected = (reading.labels != OTHER_LABEL) | self._settings.full_scene
        if self._settings.creation_rule == "paper":
            return geometry.paper_creation_mask(reading.depth_m, rendering, detected)
        return geometry.creation_mask(reading.depth_m, rendering, detected)

    def _create(self, reading: LabelImage, mask: NDArray[np.bool_]) -> int:
        means = reading.view.lift(reading.depth_m, mask)
        radius_m = reading.depth_m[mask] * np.float32(RADIUS_PX / reading.view.fx)
        self._store.append(means, radius_m, OPACITY, reading.color[mask], self._updates)
        return len(means)

    def _hindsight_weights(self, look: ViewpointMatch) -> NDArray[np.float32] | None:
        """Weight of a view [names] for Gaussians that it sees later, by hindsight; None without
        it."""
        if self._settings.evidence != "hindsight":
            return None
        return self._weights_at_first_sight(look)

    def _is_new(self, look: ViewpointMatch) -> bool:
        """True for a view that differs from all earlier ones of the search."""
        return bool(self._weights_at_first_sight(look).any())

    def _weights_at_first_sight(self, look: ViewpointMatch) -> NDArray[np.float32]:
        """Weight of a view [names] beside all earlier ones."""
        return self._viewpoints.weights(look, self._names, np.array([NEVER]))[0]

    def _add_hindsight_votes(self, rows: NDArray[np.int32]) -> None:
        """Give new Gaussians the evidence of past views that show their positions."""
        s, store = self._settings, self._store
        for shown in self._past.of(store.means[rows]):
            past = shown.past
            counts = [i for i, name in enumerate(past.names) if name in store.class_names]
            columns = [store.class_names.index(past.names[i]) for i in counts]
            voted = rows[shown.points]
            kappa = shown.labels[:, None] == [OTHER_LABEL, *(1 + i for i in counts)]
            kappa[:, 0] |= ~kappa.any(axis=1)
            weights = np.tile(past.weights[counts], (len(voted), 1))
            eye_m = past.view.T_world_cam[:3, 3]
            viewing_sectors.add_votes(
                store, voted, kappa.astype(np.float32), columns, weights, eye_m, s.side_views,
                s.alpha_side,
            )  # fmt: skip

    def _fuse(
        self,
        projection: Projection,
        labels: NDArray[np.int32],
        look: ViewpointMatch,
        eye_m: NDArray[np.float64],
        stamp_ns: int,
    ) -> int:
        """Add the evidence of a view and update the instances it changes.

        Returns the number of Gaussians that received evidence.
        """
        s, store, names = self._settings, self._store, self._names
        kappa = projection.kappa_sums(labels, 1 + len(names))
        rows = projection.rows
        store.last_seen_update[rows[kappa @ np.ones(kappa.shape[1], np.float32) > 0]] = (
            self._updates
        )
        weights = self._viewpoints.weights(look, names, store.created_update[rows])
        self._viewpoints.mark(look, names, self._updates)
        if s.by_sides:
            took = viewing_sectors.add_votes(
                store, rows, kappa, self._columns, weights, eye_m, s.side_views, s.alpha_side
            )
        else:
            took = accumulate(store, rows, kappa, self._columns, weights, s.alpha_cpa)
        rows = rows[took]
        self._believe(rows)
        given = self._registry.note_view(
            store.instance[rows], kappa[took], weights[took], projection.depth_m[took], names
        )
        if s.detector_trust != "full":
            self._drop_all()  # the learnt detector precision changes every score
        self._note_moments(given, stamp_ns)
        return len(rows)

    def _note_moments(self, labels: list[int], stamp_ns: int) -> None:
        """Append to the history of instances that received evidence, and drop their cached
        descriptions."""
        for label in labels:
            self._drop(label)
            belief = self._belief(label)
            record = self._registry.records[label]
            if belief is not None:
                scored = belief.score
                record.note(Moment(stamp_ns, record.views, scored.psi, scored.class_score))

    def _remove(self, rows: NDArray[np.integer]) -> None:
        """Remove rows from their instances and from the map."""
        if len(rows):
            self._registry.leave(self._store, rows, self._voxel_m)
            self._join(rows[:0], taken_out=True)
            self._store.remove(rows)
            self._beliefs.clear()

    def _believe(self, rows: NDArray[np.integer]) -> None:
        """Update the most likely class of rows, and the instances that this changes."""
        store = self._store
        s = self._settings
        new, in_core = most_likely_columns(
            store.class_evidence, store.total_evidence, rows, self._columns, s.prior_concentration,
            self._n_classes, s.named_from, s.core_from,
        )  # fmt: skip
        differs = np.flatnonzero(
            (new != store.class_column[rows]) | (in_core != store.in_core[rows])
        )
        changed = rows[differs]
        self._registry.leave(store, changed, self._voxel_m)
        store.class_column[changed], store.in_core[changed] = new[differs], in_core[differs]
        self._join(changed)

    def _join(self, rows: NDArray[np.integer], *, taken_out: bool = False) -> None:
        changed = self._registry.join(self._store, rows, self._voxel_m, taken_out=taken_out)
        for label in changed:
            self._drop(label)

    # Parts of a query -------------------------------------------------------------------------

    @property
    def _sectors(self) -> int:
        """Number of viewing sectors per Gaussian for which votes are kept."""
        return viewing_sectors.SECTORS if self._settings.by_sides else 0

    @property
    def _columns(self) -> list[int]:
        """Store columns of the context's classes."""
        return [self._store.class_names.index(name) for name in self._names]

    @property
    def _names(self) -> list[str]:
        return [c.name for c in self._context.distinct()] if self._context is not None else []

    @property
    def _n_classes(self) -> int:
        """Number of classes of the prior, "other" included."""
        return max(len(self._names) + 1, self._settings.prior_classes)

    def _project(
        self, view: View, far_m: float | None = None, rows: NDArray[np.int32] | None = None
    ) -> Projection:
        """Projection of some rows into a view; default: all rows that it may show."""
        store = self._store
        far_m = self._settings.max_depth_m + SEEN_BEYOND_M if far_m is None else far_m
        rows = store.seen_by(view, far_m) if rows is None else rows
        return self._back_end(store.means, store.radius_m, store.opacity, view, rows, far_m)

    def _is_receptacle(self, class_name: str) -> bool:
        return self._roles[class_name].is_receptacle

    def _voxel_m(self, class_name: str) -> float:
        s = self._settings
        large = self._is_receptacle(class_name) or is_furniture(class_name)
        return s.receptacle_voxel_m if large else s.object_voxel_m

    def _drop(self, label: int) -> None:
        """Forget the computed belief and description of an instance, which has changed."""
        self._described.pop(label, None)
        self._beliefs.pop(label, None)

    def _drop_all(self) -> None:
        self._described.clear()
        self._beliefs.clear()

    def _belief(self, label: int) -> Belief | None:
        """Belief that an instance is of its own class; None if it is too small to be reported."""
        if label not in self._beliefs:
            self._beliefs[label] = self._new_belief(label)
        return self._beliefs[label]

    def _new_belief(self, label: int) -> Belief | None:
        store, s = self._store, self._settings
        rows = store.instances.rows_of(np.array([label]))
        if len(rows) < MIN_GAUSSIANS:
            return None
        class_name, names = self._registry.records[label].class_name, list(self._names)
        if class_name not in names:
            names.append(class_name)
        trust = self._trust(label) * self._name_probability(label, rows)
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
        """Estimated share of true detections of an instance, learnt from earlier detections of its
        class."""
        trust = self._settings.detector_trust
        return (
            1.0
            if trust == "full"
            else self._registry.true_detection_share(label, trust == "class-distance")
        )

    def _name_probability(self, label: int, rows: NDArray[np.integer]) -> float:
        """Probability of an instance's own name against the other names that it was called by."""
        if self._settings.look_alikes == "ignored":
            return 1.0
        name = self._registry.records[label].class_name
        rates = self._sightings.rates(self._store.means[rows], name, self._settings.side_views)
        return 1.0 if rates is None else rates.probability(name)

    def _size_agreement(self, label: int, belief: Belief) -> float:
        """Likelihood, in (0, 1], of the measured size of an instance, given its class."""
        s, record = self._settings, self._registry.records[label]
        shape = self._shape(label, belief)
        measured_m = extents_of(shape.outline_m, float(shape.high_m[2] - shape.low_m[2]))
        top_m = None if s.floor_m is None else float(shape.high_m[2]) - s.floor_m
        views = record.views if s.size_agreement == "on" else 0.0
        return agreement(record.class_name, measured_m, views, top_m)

    def _shape(self, label: int, belief: Belief) -> Shape:
        return shape_of(self._store.means, belief, self._box_threshold(label, belief.mean))

    def _box_threshold(self, label: int, mean: NDArray[np.floating]) -> float:
        """Probability above which a Gaussian of an instance belongs to its box; mean: [n]."""
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
