"""The map of objects: one state, updated by observations, asked for objects and what-ifs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.errors import InvalidInput
from helios_core.types import ObjectInstance, Observation, Role, SearchContext
from numpy.typing import NDArray

from helios_objectmap import create, information_gain, picture, splat
from helios_objectmap.accumulate import accumulate
from helios_objectmap.belief import believe
from helios_objectmap.carve import sight
from helios_objectmap.detail import Grasp, grasp
from helios_objectmap.dirichlet import marginal
from helios_objectmap.gaussians import NO_INSTANCE, OTHER, GaussianStore
from helios_objectmap.information_gain import Expected, Member, Rates
from helios_objectmap.limit import surplus
from helios_objectmap.mapfile import Memory
from helios_objectmap.objects import BELIEVED, InstanceGaussians, describe, gaussians_of
from helios_objectmap.reading import OTHER_LABEL, Reading, read, without_held
from helios_objectmap.registry import InstanceRegistry, Moment
from helios_objectmap.reobserve import reobserved
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.view import View
from helios_objectmap.viewpoints import NEVER, Look, Viewpoints

SEEN_BEYOND_M = 1.0  # Gaussians this far beyond the depth that is used still cover what is behind
HALF = 0.5
WHOLE = 0.999  # sums of float32 shares that make a whole view


@dataclass(frozen=True)
class UpdateReport:
    """What one observation did to the map."""

    created: int
    carved: int
    in_view: int
    fused: int  # Gaussians that took evidence; 0 from a viewpoint that has counted already
    total: int


class ObjectMap:
    """Sparse 3D Gaussian map of the objects of interest. Not thread-safe: its owner locks.

    What an update costs follows what is in view, not the size of the map.
    """

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._store = GaussianStore()
        self._registry = InstanceRegistry()
        self._viewpoints = self.no_viewpoints()
        self._context: SearchContext | None = None
        self._roles: dict[str, Role] = {}
        self._updates = 0
        self._described: dict[int, ObjectInstance | None] = {}  # None: too small to be reported

    def __len__(self) -> int:
        return len(self._store)

    # Updates ------------------------------------------------------------------------------------

    def set_context(self, context: SearchContext) -> None:
        """Ask for the classes of a context from now on; what is known of others stays."""
        if context == self._context:
            return
        store = self._store
        voxels = {
            r.class_name: self._voxel_m(r.class_name) for r in self._registry.records.values()
        }
        self._context = context
        for c in context.classes:
            store.column(c.name)
            self._roles.pop(c.name, None)  # those at the end were asked for last
            self._roles[c.name] = c.role
        self._forget_classes(
            list(self._roles)[: -max(self._settings.max_classes, len(self._names))]
        )
        lost = {
            label
            for label, record in self._registry.records.items()
            if self._voxel_m(record.class_name) != voxels[record.class_name]
        }
        self._believe(np.arange(len(store)), lost)
        self._described.clear()

    def update(
        self, observation: Observation, context: SearchContext, held: str = ""
    ) -> UpdateReport:
        """Integrate one observation made for a context. held: class of what the robot holds."""
        self.set_context(context)
        s, store = self._settings, self._store
        reading = without_held(
            read(observation, context, s.stride_px, s.min_depth_m, s.max_depth_m),
            context, held, s.held_object_m,
        )  # fmt: skip
        look = self._viewpoints.look(reading.view.T_world_cam)
        projection = self._project(reading.view)
        carved, lost = 0, set()
        if s.creation_rule != "paper":
            carved, lost = self._carve(projection, reading, look)
            if carved:
                projection = self._project(reading.view)
        rendering = splat.render(projection)

        created_mask = self._creation_mask(reading, rendering)
        created = self._create(reading, created_mask)
        if created:
            projection = self._project(reading.view)
        seen = reobserved(
            reading.depth_m, rendering, created_mask, s.reobserve_agreement_m, s.closing_px
        )
        labels = np.where(seen, reading.labels, -1).astype(np.int32)
        fused = self._fuse(projection, labels, look, lost, observation.frame.stamp_ns)
        self._updates += 1
        gone = surplus(store.believed, store.seen, s.max_gaussians)
        self._recluster(gone[:0], self._remove(gone))
        return UpdateReport(created, carved, len(projection.rows), fused, len(store))

    def retire(self, instance_id: int) -> int:
        """Remove an object that was picked; the number of Gaussians removed, 0 if unknown.

        Everything in its box that is not believed to be a receptacle goes with it.
        """
        store = self._store
        member = store.instances.rows_of(np.array([instance_id]))
        if not len(member):
            return 0
        low, high = store.means[member].min(axis=0), store.means[member].max(axis=0)
        near = store.blocks.near(store.means[member], float((high - low).max()))
        inside = ((store.means[near] >= low) & (store.means[near] <= high)).all(axis=1)
        receptacles = [i for i, name in enumerate(store.class_names) if self._is_receptacle(name)]
        inside &= ~np.isin(store.believed[near], receptacles)
        gone = np.union1d(member, near[inside])
        self._recluster(gone[:0], self._remove(gone))
        return len(gone)

    def nearest_object(self, point_m: NDArray[np.float64], within_m: float) -> int | None:
        """Id of the nearest instance that is no receptacle, or None where none is that near."""
        near = [
            (float(np.linalg.norm(o.center_m - point_m)), o.id)
            for o in self.objects()
            if not self._is_receptacle(o.class_name)
        ]
        distance, label = min(near, default=(np.inf, NO_INSTANCE))
        return label if distance <= within_m else None

    # Questions ----------------------------------------------------------------------------------

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
        self, instance_id: int, class_name: str, views: Sequence[View]
    ) -> tuple[list[Expected], Expected] | None:
        """Score and information gain if views showed an instance as a class (eq. 11 and 12).

        views: full-resolution cameras with poses. Returns the outcome of each view alone and of
        all together, or None where there is no such instance or class.
        """
        store, s = self._store, self._settings
        rows = store.instances.rows_of(np.array([instance_id]))
        if not len(rows) or class_name not in store.class_names:
            return None
        column = store.class_names.index(class_name)
        columns = self._columns if column in self._columns else [*self._columns, column]
        member = Member(
            store.means[rows],
            store.radius_m[rows],
            store.opacity[rows],
            store.positive[rows][:, columns],
            store.asked[rows, column],
        )
        return information_gain.what_if(
            member,
            columns.index(column),
            [view.strided(s.stride_px) for view in views],
            Rates(
                s.prior_concentration,
                s.alpha_cpa,
                s.alpha_cs,
                HALF if s.assumption == "50-50" else 0.0,
            ),
            s.max_depth_m,
        )

    def gaussians(self, instance_id: int | None = None) -> InstanceGaussians:
        """Copies of the Gaussians of an instance, or of all instances."""
        if instance_id is None:
            rows = np.flatnonzero(self._store.instance != NO_INSTANCE)
        else:
            rows = self._store.instances.rows_of(np.array([instance_id]))
        return gaussians_of(self._store, rows, self._settings.prior_concentration)

    def render(self, view: View, layer: str, class_name: str) -> bytes:
        """PNG of a layer as a camera sees it; RGB, or for depth uint16 millimetres.

        layer: one of `picture.LAYERS`; the last two are of a class. Raises InvalidInput.
        """
        store, prior = self._store, self._settings.prior_concentration
        projection = self._project(view, splat.FAR_M)
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
            store.positive[rows, column], store.asked[rows, column], prior, len(self._names) + 1
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
            self._settings.prior_concentration, len(self._names) + 1,
        )  # fmt: skip
        believed = rows[mean > BELIEVED]
        return grasp(store.means[believed if len(believed) else rows])

    # On disk ------------------------------------------------------------------------------------

    def memory(self) -> Memory:
        """All that is known; its parts are the map's own, not copies."""
        return Memory(self._store, self._registry, self._viewpoints, self._roles, self._updates)

    def recall(self, memory: Memory) -> None:
        """Know what a file holds, and nothing else."""
        self.reset()
        self._store, self._registry = memory.store, memory.registry
        self._viewpoints, self._roles = memory.viewpoints, memory.roles
        self._updates = memory.updates

    def no_viewpoints(self) -> Viewpoints:
        """Empty ones, as this map's settings want them."""
        return Viewpoints(self._settings.viewpoint_moved_m, self._settings.viewpoint_turned_rad)

    # Parts --------------------------------------------------------------------------------------

    @property
    def _columns(self) -> list[int]:
        """Of the context's classes in the store."""
        return [self._store.class_names.index(name) for name in self._names]

    @property
    def _names(self) -> list[str]:
        return [c.name for c in self._context.classes] if self._context is not None else []

    def _project(self, view: View, far_m: float | None = None) -> splat.Projection:
        store = self._store
        far_m = self._settings.max_depth_m + SEEN_BEYOND_M if far_m is None else far_m
        rows = store.seen_by(view, far_m)
        return splat.project(store.means, store.radius_m, store.opacity, view, rows, far_m)

    def _forget_classes(self, names: list[str]) -> None:
        """All evidence for some classes goes, and the instances of them."""
        store = self._store
        if not names:
            return
        columns = [store.class_names.index(name) for name in names]
        rows = np.flatnonzero(np.isin(store.believed, columns))
        lost = set(np.unique(store.instance[rows]).tolist())
        store.believed[rows] = OTHER
        store.instances.move(rows, NO_INSTANCE)
        self._recluster(rows[:0], lost)
        store.drop_columns(names)
        for name in names:
            self._viewpoints.forget(name)
            del self._roles[name]

    def _carve(
        self, projection: splat.Projection, reading: Reading, look: Look
    ) -> tuple[int, set[int]]:
        """Fade what is seen through, remove it once enough views did, restore what is there.

        Returns how many were removed, and the labels of the instances that lost some.
        """
        s, store = self._settings, self._store
        seen = sight(projection, reading.depth_m, s.carve_front_m)
        there = projection.rows[seen.there]
        there = there[store.through[there] > 0]
        store.through[there], store.through_from[there] = 0, NEVER
        through = projection.rows[seen.through]
        share = self._viewpoints.between(look, store.through_from[through])
        counted = through[share > 0]
        store.through[counted] += share[share > 0]
        store.through_from[counted] = look.viewpoint
        for rows in (there, counted):
            left = np.maximum(1 - store.through[rows] / s.carve_views, 0)
            store.opacity[rows] = s.opacity * left
        gone = through[store.through[through] >= WHOLE * s.carve_views]
        return len(gone), self._remove(gone)

    def _creation_mask(self, reading: Reading, rendering: splat.Rendering) -> NDArray[np.bool_]:
        detected = reading.labels != OTHER_LABEL
        if self._settings.creation_rule == "paper":
            return create.paper_creation_mask(reading.depth_m, rendering, detected)
        return create.creation_mask(
            reading.depth_m, rendering, detected, self._settings.create_front_m
        )

    def _create(self, reading: Reading, mask: NDArray[np.bool_]) -> int:
        means = reading.view.lift(reading.depth_m, mask)
        radius_m = reading.depth_m[mask] * np.float32(self._settings.radius_px / reading.view.fx)
        self._store.append(
            means, radius_m, self._settings.opacity, reading.color[mask], self._updates
        )
        return len(means)

    def _fuse(
        self,
        projection: splat.Projection,
        labels: NDArray[np.int32],
        look: Look,
        lost: set[int],
        stamp_ns: int,
    ) -> int:
        """Take the evidence of a view and renew the instances that it changed."""
        store, names = self._store, self._names
        kappa = splat.kappa_sums(projection, labels, 1 + len(names))
        rows = projection.rows
        store.seen[rows[kappa.any(axis=1)]] = self._updates
        weights = self._viewpoints.weights(look, names, store.born[rows])
        takes = np.flatnonzero(kappa.any(axis=1) & weights.any(axis=1))
        rows, kappa, weights = rows[takes], kappa[takes], weights[takes]
        self._viewpoints.mark(look, names, self._updates)
        accumulate(store, rows, kappa, self._columns, weights, self._settings.alpha_cpa)
        self._believe(rows, lost)
        self._registry.note_view(store.instance[rows], kappa, weights, names)
        seen = np.unique(store.instance[rows]).tolist()
        self._note_moments([label for label in seen if label != NO_INSTANCE], stamp_ns)
        return len(rows)

    def _note_moments(self, labels: list[int], stamp_ns: int) -> None:
        """Add to the history of instances that took evidence; they are described anew."""
        for label in labels:
            self._described[label] = o = self._describe(label)
            record = self._registry.records[label]
            if o is not None:
                record.note(Moment(stamp_ns, record.views, o.score, o.class_score))

    def _remove(self, rows: NDArray[np.integer]) -> set[int]:
        """Remove rows; returns the labels of the instances that lost some."""
        if not len(rows):
            return set()
        lost = set(np.unique(self._store.instance[rows]).tolist())
        self._store.remove(rows)
        return lost

    def _believe(self, rows: NDArray[np.integer], lost: set[int]) -> None:
        """Renew the beliefs of rows, and the instances that this or a loss changes."""
        store = self._store
        prior = self._settings.prior_concentration
        new = believe(store.positive[rows], store.asked[rows], self._columns, prior)
        differs = np.flatnonzero(new != store.believed[rows])
        changed = rows[differs]
        lost = lost | set(np.unique(store.instance[changed]).tolist())
        store.believed[changed] = new[differs]
        store.instances.move(changed, NO_INSTANCE)
        self._recluster(changed, lost)

    def _recluster(self, rows: NDArray[np.integer], lost: Iterable[int]) -> None:
        for label in self._registry.cluster(self._store, rows, lost, self._voxel_m):
            self._described.pop(label, None)

    def _is_receptacle(self, class_name: str) -> bool:
        return self._roles[class_name].is_receptacle

    def _voxel_m(self, class_name: str) -> float:
        s = self._settings
        return s.receptacle_voxel_m if self._is_receptacle(class_name) else s.object_voxel_m

    def _describe(self, label: int) -> ObjectInstance | None:
        store, s = self._store, self._settings
        rows = store.instances.rows_of(np.array([label]))
        if len(rows) < s.min_gaussians:
            return None
        record = self._registry.records[label]
        names, columns = list(self._names), list(self._columns)
        if record.class_name not in names:
            names.append(record.class_name)
            columns.append(store.class_names.index(record.class_name))
        mean, deviation = marginal(
            store.positive[rows][:, columns],
            store.asked[rows][:, columns],
            s.prior_concentration,
            len(self._names) + 1,
        )
        return describe(label, record, store.means[rows], mean, deviation, names, s.alpha_cs)
