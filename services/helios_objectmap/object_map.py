"""The map of objects: one state, updated by observations, asked for objects and what-ifs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from helios_core.types import ObjectInstance, Observation, Role, SearchContext
from numpy.typing import NDArray

from helios_objectmap import create, information_gain, splat
from helios_objectmap.accumulate import accumulate
from helios_objectmap.belief import believe
from helios_objectmap.dirichlet import marginal
from helios_objectmap.gaussians import NO_INSTANCE, GaussianStore
from helios_objectmap.information_gain import Expected, Member
from helios_objectmap.objects import InstanceGaussians, describe, gaussians_of
from helios_objectmap.reading import OTHER_LABEL, Reading, read, without_held
from helios_objectmap.registry import InstanceRegistry
from helios_objectmap.reobserve import reobserved
from helios_objectmap.settings import ObjectMapSettings
from helios_objectmap.view import View
from helios_objectmap.viewpoints import Viewpoints


@dataclass(frozen=True)
class UpdateReport:
    """What one observation did to the map."""

    created: int
    carved: int
    in_view: int
    fused: int  # Gaussians that took evidence; 0 from a viewpoint that has counted already
    total: int


class ObjectMap:
    """Sparse 3D Gaussian map of the objects of interest. Not thread-safe: its owner locks."""

    def __init__(self, settings: ObjectMapSettings) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._store = GaussianStore()
        self._registry = InstanceRegistry()
        self._viewpoints = Viewpoints(
            self._settings.viewpoint_moved_m, self._settings.viewpoint_turned_rad
        )
        self._context: SearchContext | None = None
        self._roles: dict[str, Role] = {}
        self._columns: list[int] = []  # of the context's classes in the store
        self._updates = 0

    def __len__(self) -> int:
        return len(self._store)

    # Updates ------------------------------------------------------------------------------------

    def set_context(self, context: SearchContext) -> None:
        """Ask for the classes of a context from now on; what is known of others stays."""
        if context == self._context:
            return
        self._context = context
        self._columns = [self._store.column(c.name) for c in context.classes]
        self._roles.update({c.name: c.role for c in context.classes})
        self._believe(np.arange(len(self._store)))
        self._cluster(set(range(len(self._store.class_names))))

    def update(
        self, observation: Observation, context: SearchContext, held: str = ""
    ) -> UpdateReport:
        """Integrate one observation made for a context. held: class name of what the robot holds.

        Geometry always updates; evidence counts once per viewpoint (viewpoints.py).
        """
        self.set_context(context)
        s, store = self._settings, self._store
        reading = read(observation, context, s.stride_px, s.min_depth_m, s.max_depth_m)
        if held:
            reading = without_held(reading, context, held, s.held_object_m)

        projection = self._project(reading.view)
        changed, carved = set(), 0
        if s.creation_rule != "paper":
            through = create.seen_through(projection, reading.depth_m, s.carve_front_m)
            changed, carved = set(store.believed[through].tolist()), len(through)
            store.remove(through)
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
        changed, fused = self._fuse(projection, labels, reading.view, changed)
        self._updates += 1
        return UpdateReport(created, carved, len(projection.visible), fused, len(store))

    def retire(self, instance_id: int) -> int:
        """Remove an object that was picked; the number of Gaussians removed, 0 if unknown.

        Everything in its box that is not believed to be a receptacle goes with it.
        """
        store = self._store
        member = store.instance == instance_id
        if instance_id == NO_INSTANCE or not member.any():
            return 0
        low, high = store.means[member].min(axis=0), store.means[member].max(axis=0)
        inside = ((store.means >= low) & (store.means <= high)).all(axis=1)
        receptacles = [i for i, name in enumerate(store.class_names) if self._is_receptacle(name)]
        gone = np.flatnonzero(member | (inside & ~np.isin(store.believed, receptacles)))
        changed = set(store.believed[gone].tolist())
        store.remove(gone)
        self._cluster(changed)
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
        store = self._store
        rows = np.flatnonzero(store.instance != NO_INSTANCE)
        rows = rows[np.argsort(store.instance[rows], kind="stable")]
        labels, starts = np.unique(store.instance[rows], return_index=True)
        groups = np.split(rows, starts[1:]) if len(rows) else []
        return tuple(
            self._describe(int(label), group)
            for label, group in zip(labels, groups, strict=True)
            if len(group) >= self._settings.min_gaussians
        )

    def what_if(
        self, instance_id: int, class_name: str, views: Sequence[View]
    ) -> tuple[list[Expected], Expected] | None:
        """Score and information gain if views showed an instance as a class (eq. 11 and 12).

        views: full-resolution cameras with poses. Returns the outcome of each view alone and of
        all together, or None where there is no such instance or class.
        """
        store, s = self._store, self._settings
        rows = np.flatnonzero(store.instance == instance_id)
        if instance_id == NO_INSTANCE or not len(rows) or class_name not in store.class_names:
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
            s.prior_concentration,
            s.alpha_cpa,
            s.alpha_cs,
            s.max_depth_m,
        )

    def gaussians(self, instance_id: int | None = None) -> InstanceGaussians:
        """Copies of the Gaussians of an instance, or of all instances."""
        instance = self._store.instance
        member = instance != NO_INSTANCE if instance_id is None else instance == instance_id
        return gaussians_of(self._store, np.flatnonzero(member), self._settings.prior_concentration)

    # Parts --------------------------------------------------------------------------------------

    def _project(self, view: View) -> splat.Projection:
        return splat.project(self._store.means, self._store.radius_m, self._store.opacity, view)

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
        view: View,
        changed: set[int],
    ) -> tuple[set[int], int]:
        """Take the evidence of a view and renew the instances of the classes it changed."""
        store = self._store
        names = [store.class_names[c] for c in self._columns]
        kappa = splat.kappa_sums(projection, labels, 1 + len(names))
        rows = np.flatnonzero(kappa.any(axis=1))
        viewpoint = self._viewpoints.match(view.T_world_cam)
        counts = self._viewpoints.counts(viewpoint, names, store.born[rows])
        takes = counts.any(axis=1)
        rows, kappa, counts = rows[takes], kappa[rows[takes]], counts[takes]
        self._viewpoints.mark(viewpoint, names, self._updates)
        accumulate(store, rows, kappa, self._columns, counts, self._settings.alpha_cpa)
        changed = changed | self._believe(rows)
        self._cluster(changed)
        self._registry.note_view(viewpoint, store.instance[rows], kappa, names)
        return changed, len(rows)

    def _believe(self, rows: NDArray[np.integer]) -> set[int]:
        """Renew the beliefs of rows; returns the columns whose members changed."""
        store = self._store
        prior = self._settings.prior_concentration
        new = believe(store.positive[rows], store.asked[rows], self._columns, prior)
        old = store.believed[rows]
        differs = np.flatnonzero(new != old)
        store.believed[rows[differs]] = new[differs]
        store.instance[rows[differs]] = NO_INSTANCE
        return set(old[differs].tolist()) | set(new[differs].tolist())

    def _cluster(self, columns: set[int]) -> None:
        self._registry.cluster(self._store, sorted(columns), self._voxel_m)

    def _is_receptacle(self, class_name: str) -> bool:
        return self._roles[class_name].is_receptacle

    def _voxel_m(self, class_name: str) -> float:
        s = self._settings
        return s.receptacle_voxel_m if self._is_receptacle(class_name) else s.object_voxel_m

    def _describe(self, label: int, rows: NDArray[np.integer]) -> ObjectInstance:
        store, s = self._store, self._settings
        record = self._registry.records[label]
        names = [store.class_names[c] for c in self._columns]
        columns = list(self._columns)
        if record.class_name not in names:
            names.append(record.class_name)
            columns.append(store.class_names.index(record.class_name))
        mean, deviation = marginal(
            store.positive[rows][:, columns],
            store.asked[rows][:, columns],
            s.prior_concentration,
            len(self._columns) + 1,
        )
        return describe(label, record, store.means[rows], mean, deviation, names, s.alpha_cs)
