"""Object map: updates from observations, and queries about its instances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.geometry import Matrix
from helios_core.types import AlignedBox, ObjectInstance, Observation, SearchContext
from numpy.typing import NDArray

from helios_objectmap import export, placed
from helios_objectmap.camera import View
from helios_objectmap.error_model import name_errors
from helios_objectmap.fusion import geometry, viewing_sectors
from helios_objectmap.fusion.floor import without_depth_below, without_labels_below
from helios_objectmap.fusion.geometry import compare_with_depth, reobserved
from helios_objectmap.fusion.label_image import OTHER_LABEL, LabelImage, read, without_held
from helios_objectmap.fusion.semantics import accumulate, marginal, most_likely_columns
from helios_objectmap.fusion.view_history import PastViews
from helios_objectmap.gaussians import (
    NO_INSTANCE,
    OTHER,
    GaussianStore,
    InstanceGaussians,
    mark_seen_kernel,
    surplus,
)
from helios_objectmap.instances import information_gain
from helios_objectmap.instances.beliefs import InstanceBeliefs
from helios_objectmap.instances.information_gain import (
    EvidenceParameters,
    Expected,
    InstanceEvidence,
)
from helios_objectmap.instances.registry import InstanceRegistry, Moment
from helios_objectmap.instances.summary import (
    Grasp,
    gaussians_of,
    grasp,
    seen_area_m2,
)
from helios_objectmap.persistence import MapContent
from helios_objectmap.rendering.back_ends import back_end
from helios_objectmap.rendering.renderer_interface import FAR_M, Projection, Rendering
from helios_objectmap.searched_classes import SearchedClasses
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.shown_object import ShownNames, ShownObject
from helios_objectmap.viewpoint_weights import NEVER, ViewpointMatch, Viewpoints

SEEN_BEYOND_M = 1.0  # margin beyond max_depth_m: Gaussians within it still occlude
HELD_OBJECT_M = 1.0  # while the gripper holds an object, nearer pixels of objects belong to it
PICKED_M = 0.1  # half the width of a thing that a gripper picks, or more
OPACITY = 0.99  # of a new Gaussian
RADIUS_PX = 1.0  # standard deviation of a new Gaussian in the image
CARVE_VIEWS = 2.0  # distinct views through a Gaussian that remove it
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
        """Raises InvalidInput for an error model that cannot be read."""
        self._settings, self._name_errors = settings, name_errors(settings.error_model)
        self._back_end = back_end(settings.renderer)
        self.reset()

    def reset(self) -> None:
        """Delete all content."""
        store = GaussianStore(self._sectors)
        self._hold(MapContent(store, InstanceRegistry(), self.empty_viewpoints(), {}, 0))

    def _hold(self, content: MapContent) -> None:
        """Take over a content; the past views, which it lacks, are empty."""
        self._store, self._registry = content.store, content.registry
        self._viewpoints, self._updates = content.viewpoints, content.updates
        self._added_updates = content.added_updates
        self._classes = SearchedClasses(self._settings, content.roles)
        self._past = PastViews()
        self._sightings, self._image_text = content.sightings, content.image_text
        self._shown = ShownObject()
        self._beliefs = InstanceBeliefs(
            self._settings,
            self._store,
            self._registry,
            self._classes,
            self._sightings,
            self._name_errors,
            self._image_text,
        )

    def __len__(self) -> int:
        return len(self._store)

    # Updates ----------------------------------------------------------------------------------

    def set_context(self, context: SearchContext) -> None:
        """Search for the classes of a context from now on; the evidence for other classes stays."""
        store, classes = self._store, self._classes
        if context == classes.context:
            return
        groups = {r.group for r in self._registry.records.values()}
        voxels = {g.class_name: classes.voxel_m(g.class_name) for g in groups}
        classes.search(context)
        for name in classes.names:
            store.column(name)
        self._forget_classes(classes.oldest())
        for group in sorted(g for g in groups if g.class_name in classes.roles):
            voxel_m = classes.voxel_m(group.class_name)
            if voxel_m != voxels[group.class_name]:
                self._registry.recluster(store, group, voxel_m)
        self._believe(np.arange(len(store)))
        self._beliefs.drop_all()

    def update(
        self, observation: Observation, context: SearchContext, held: str = ""
    ) -> UpdateReport:
        """Integrate one observation made for a context. held: class of the object that the robot
        holds. A frame in which the robot shows it counts for `shown_names` alone."""
        self.set_context(context)
        s, store = self._settings, self._store
        self._shown.note(observation)
        if observation.frame.shown is not None:
            return UpdateReport(0, 0, 0, 0, len(store))
        reading = self._read(observation, context, held)
        look = self._viewpoints.locate(reading.view.T_world_cam)
        weights = self._viewpoints.weights_of_view(look, self._names)
        new_for = {name for name, w in zip(self._names, weights.tolist(), strict=True) if w > 0}
        if new_for:
            self._note_names(reading, observation, new_for)
        projection = self._project(reading.view)
        self._beliefs.drop_rows(np.unique(store.instance[projection.rows]).tolist())
        gone = np.empty(0, np.int32)
        if s.carving:
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
        fused = self._fuse(projection, labels, look, eye_m, observation.frame.stamp_ns)
        if s.evidence == "hindsight":
            self._past.note(reading, self._names, weights)
        self._updates += 1
        if len(gone):
            self._beliefs.drop_rows(store.remove(gone).tolist())
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
        receptacles = [
            i for i, name in enumerate(store.class_names) if self._classes.is_receptacle(name)
        ]
        inside &= ~np.isin(store.class_column[near], receptacles)
        gone = np.union1d(member, near[inside])
        self._forget_views_of(store.means[member])
        self._remove(gone)
        return len(gone)

    def forget_place(self, point_m: NDArray[np.float64]) -> None:
        """Forget what earlier views say about a point [3] where an unknown thing was picked."""
        steps_m = np.linspace(-PICKED_M, PICKED_M, 5)
        near_m = np.stack(np.meshgrid(*(x + steps_m for x in point_m)), -1).reshape(-1, 3)
        self._forget_views_of(near_m.astype(np.float32))
        self._beliefs.drop_all()

    # Queries ----------------------------------------------------------------------------------

    def nearest_object(self, point_m: NDArray[np.float64], within_m: float) -> int | None:
        """Id of the nearest instance that is not a receptacle; None if none is that near."""
        near = [
            (float(np.linalg.norm(o.center_m - point_m)), o.id)
            for o in self.objects()
            if not self._classes.is_receptacle(o.class_name)
        ]
        distance, label = min(near, default=(np.inf, NO_INSTANCE))
        return label if distance <= within_m else None

    def objects(self) -> tuple[ObjectInstance, ...]:
        """All instances with enough Gaussians, by id."""
        registry = self._registry
        known = ((label, self._beliefs.described(label)) for label in sorted(registry.records))
        return tuple(
            o for label, o in known if o is not None and not registry.is_beside_core(label)
        )

    def shown_names(self, class_name: str) -> ShownNames:
        """Names of the object that the robot shows, or showed last, against those of a class."""
        rated = None if self._settings.image_text == "ignored" else self._image_text
        return self._shown.names(class_name, self._name_errors, rated)

    def probability_in(self, class_name: str, box: AlignedBox) -> float:
        """Probability that the thing in a box is of a class (`NameSightings.probability_in`)."""
        side_views = self._settings.side_views
        return self._sightings.probability_in(class_name, box, side_views, self._name_errors)

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
            belief = self._beliefs.belief(instance_id)
        column = store.class_names.index(class_name)
        columns = self._columns if column in self._columns else [*self._columns, column]
        parameters = EvidenceParameters.of(
            s,
            belief.trust if belief is not None else 1.0,
            other_share,
            self._beliefs.image_text_nats(instance_id) or 0.0,
        )
        return information_gain.what_if(
            self._back_end,
            InstanceEvidence.of(store, rows, columns, column),
            columns.index(column),
            [view.strided(s.stride_px) for view in views],
            parameters,
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
        prior = self._settings.prior_concentration, self._classes.prior_classes
        return export.layer_png(self._project(view, FAR_M), self._store, layer, class_name, prior)

    def grasp(self, instance_id: int) -> Grasp | None:
        """Points and grasp box of the Gaussians of an instance that have its class; None if
        unknown."""
        store = self._store
        rows = store.instances.rows_of(np.array([instance_id]))
        if not len(rows):
            return None
        column = store.class_names.index(self._registry.records[instance_id].class_name)
        mean, _ = marginal(
            store.class_evidence[rows, column],
            store.total_evidence[rows, column],
            self._settings.prior_concentration,
            self._classes.prior_classes,
        )
        own = rows[mean > self._beliefs.box_threshold(instance_id, mean)]
        return grasp(store.means[own if len(own) else rows])

    # On disk ----------------------------------------------------------------------------------

    def content(self) -> MapContent:
        """Content of the map; its parts are the map's own objects, not copies."""
        return MapContent(
            self._store,
            self._registry,
            self._viewpoints,
            self._classes.roles,
            self._updates,
            self._sightings,
            self._image_text,
            self._added_updates,
        )

    def load_content(self, content: MapContent) -> None:
        """Replace the content of the map with that of a file.

        The evidence stays as the file has it. A map that counts views drops votes by viewing
        sector. A map that counts sectors starts with empty ones if the file has no votes. The
        instances are clustered with the voxels of this map, which may differ from the file's.
        """
        self._hold(content)
        self._store.keep_votes(self._sectors)
        groups = sorted({r.group for r in self._registry.records.values()})
        for name in sorted({group.class_name for group in groups}):
            if self._settings.joined_by == "detections" and self._classes.is_receptacle(name):
                self._registry.keep_apart(self._store, name, self._classes.voxel_m(name))
        for group in groups:
            self._registry.recluster(self._store, group, self._classes.voxel_m(group.class_name))

    def empty_viewpoints(self) -> Viewpoints:
        """An empty `Viewpoints`."""
        return Viewpoints(all_in_full=self._settings.view_weights == "full")

    def add_stored(self, content: MapContent, T_here_there: Matrix) -> int:
        """Add the content of another map whose place in this frame is known. Returns the number of
        Gaussians added.

        Where both maps have Gaussians of one object, these become one instance. Directions of view
        are kept to the nearest viewing sector. The views of the other map may count again.
        """
        store, there = self._store, content.store
        labels = there.instance.copy()
        rows = placed.append_stored(store, there, T_here_there, self._updates, self._sectors)
        self._added_updates.append(self._updates)
        self._updates += 1
        self._classes.add_roles(content.roles)
        self._join(rows)
        self._registry.inherit_from(store.instance[rows], labels, content.registry)
        self._sightings.add_earlier(content.sightings.arrays(), T_here_there)
        self._image_text.add_stored(content.image_text.arrays(), T_here_there)
        self._beliefs.drop_all()
        return len(rows)

    def added_objects(self) -> frozenset[int]:
        """Ids of the instances with Gaussians that `add_stored` added."""
        if not self._added_updates:
            return frozenset()
        added = self._store.instance[np.isin(self._store.created_update, self._added_updates)]
        return frozenset(np.unique(added).tolist()) - {NO_INSTANCE}

    # Parts of an update -----------------------------------------------------------------------

    def _forget_classes(self, names: list[str]) -> None:
        """Remove all evidence for some classes, and their instances."""
        store = self._store
        if not names:
            return
        columns = [store.class_names.index(name) for name in names]
        rows = np.flatnonzero(np.isin(store.class_column, columns))
        self._registry.leave(store, rows, self._classes.voxel_m)
        store.class_column[rows] = OTHER
        self._join(rows)
        store.drop_columns(names)
        self._image_text.forget(names)
        self._past.forget(lambda name: name in names)
        for name in names:
            self._viewpoints.forget(name)
            self._registry.ended.pop(name, None)
            self._registry.separations.pop(name, None)
            del self._classes.roles[name]

    def _forget_views_of(self, points: NDArray[np.float32]) -> None:
        """Forget the names and scores of views at points [n, 3] where a thing was picked, and the
        evidence of past views on objects anywhere."""
        self._sightings.forget_at(points)
        self._image_text.forget_at(points)
        self._past.forget(lambda name: not self._classes.is_receptacle(name))

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
        self._registry.leave(store, gone, self._classes.voxel_m)
        store.class_column[gone] = OTHER
        return projection.renewed(
            np.concatenate([there, seen.through[share > 0]]),
            self._project(reading.view, rows=stays),
        ), gone

    def _read(self, observation: Observation, context: SearchContext, held: str) -> LabelImage:
        s, by_score = self._settings, self._settings.equal_masks == "by-score"
        reading = read(observation, context, s.stride_px, s.min_depth_m, s.max_depth_m, by_score)
        reading = without_held(reading, context, held, HELD_OBJECT_M)
        labels = self._classes.labels_off_floor()
        return without_labels_below(reading, labels, s.furniture_from_m)

    def _note_names(self, reading: LabelImage, observation: Observation, new_for: set[str]) -> None:
        """Note the names, the image-text scores and the co-detections of a view.

        new_for: classes for which the view differs from all earlier ones; there is at least one.
        Image-text scores and co-detections of other classes are left out. Detections count under
        all names, because the map compares each name with all others.
        """
        s, classes = self._settings, self._classes
        if s.look_alikes != "ignored":
            detections = (*observation.detections, *observation.others)
            self._sightings.note(reading, s.stride_px, detections)
        if s.image_text != "ignored":
            scores = classes.among(observation.class_scores)
            self._image_text.note(reading, {n: v for n, v in scores.items() if n in new_for})
        if s.joined_by == "detections":
            sure = classes.sure_receptacles(observation.detections)
            self._registry.note_co_detections(
                without_depth_below(reading, s.furniture_from_m),
                s.stride_px,
                [d for d in sure if d.class_name in new_for],
                classes.voxel_m,
            )

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

    def _add_hindsight_votes(self, rows: NDArray[np.int32]) -> None:
        """Give new Gaussians the evidence of past views that show their positions."""
        s, store = self._settings, self._store
        shown = list(self._past.of(store.means[rows]))
        viewing_sectors.add_past_votes(store, rows, shown, s.side_views, s.alpha_side)

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
        mark_seen_kernel(rows, kappa, store.last_seen_update, self._updates)
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
            store.instance[rows], took, kappa, weights, projection.depth_m, names
        )
        if s.detector_trust != "full":
            self._beliefs.drop_all()  # the learnt detector precision changes every score
        self._note_moments(given, stamp_ns)
        return len(rows)

    def _note_moments(self, labels: list[int], stamp_ns: int) -> None:
        """Append to the history of instances that received evidence, and drop their cached
        descriptions."""
        self._beliefs.drop(labels)
        for label in labels:
            scored = self._beliefs.score(label)
            record = self._registry.records[label]
            if scored is not None:
                record.note(Moment(stamp_ns, record.views, scored.psi, scored.class_score))

    def _remove(self, rows: NDArray[np.integer]) -> None:
        """Remove rows from their instances and from the map."""
        if len(rows):
            self._registry.leave(self._store, rows, self._classes.voxel_m)
            self._join(rows[:0], taken_out=True)
            self._beliefs.drop_rows(self._store.remove(rows).tolist())

    def _believe(self, rows: NDArray[np.integer]) -> None:
        """Update the most likely class of rows, and the instances that this changes."""
        store = self._store
        s = self._settings
        new, in_core = most_likely_columns(
            store.class_evidence,
            store.total_evidence,
            rows,
            self._columns,
            s.prior_concentration,
            self._classes.prior_classes,
            s.named_from,
            s.core_from,
        )
        differs = np.flatnonzero(
            (new != store.class_column[rows]) | (in_core != store.in_core[rows])
        )
        changed = rows[differs]
        self._registry.leave(store, changed, self._classes.voxel_m)
        store.class_column[changed], store.in_core[changed] = new[differs], in_core[differs]
        self._join(changed)

    def _join(self, rows: NDArray[np.integer], *, taken_out: bool = False) -> None:
        changed = self._registry.join(self._store, rows, self._classes.voxel_m, taken_out=taken_out)
        self._beliefs.drop(changed)

    # Parts of a query -------------------------------------------------------------------------

    @property
    def _sectors(self) -> int:
        """Number of viewing sectors per Gaussian for which votes are kept."""
        return viewing_sectors.SECTORS if self._settings.by_sides else 0

    @property
    def _columns(self) -> list[int]:
        """Store columns of the context's classes."""
        return self._classes.columns(self._store)

    @property
    def _names(self) -> list[str]:
        return self._classes.names

    def _project(
        self, view: View, far_m: float | None = None, rows: NDArray[np.int32] | None = None
    ) -> Projection:
        """Projection of some rows into a view; default: all rows that it may show."""
        store = self._store
        far_m = self._settings.max_depth_m + SEEN_BEYOND_M if far_m is None else far_m
        rows = store.seen_by(view, far_m) if rows is None else rows
        return self._back_end(store.means, store.radius_m, store.opacity, view, rows, far_m)
