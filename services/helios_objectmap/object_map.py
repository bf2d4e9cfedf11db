"""The map of objects: how observations, contexts and retirements change what it knows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from helios_core.types import Observation, SearchContext
from numpy.typing import NDArray

from helios_objectmap.evidence import create, sides
from helios_objectmap.evidence.accumulate import accumulate
from helios_objectmap.evidence.belief import believe
from helios_objectmap.evidence.carve import sight
from helios_objectmap.evidence.hindsight import PastViews
from helios_objectmap.evidence.reading import OTHER_LABEL, Reading, read, without_held
from helios_objectmap.evidence.reobserve import reobserved
from helios_objectmap.instances.registry import Moment
from helios_objectmap.knowledge import Knowledge
from helios_objectmap.rendering.renderer import Projection, Rendering
from helios_objectmap.store.gaussians import OTHER
from helios_objectmap.store.limit import surplus
from helios_objectmap.store.viewpoints import NEVER, Look

WHOLE = 0.999  # sums of float32 shares that make a whole view


@dataclass(frozen=True)
class UpdateReport:
    """What one observation did to the map."""

    created: int
    carved: int
    in_view: int
    fused: int  # Gaussians that took evidence; 0 from a viewpoint that has counted already
    total: int


class ObjectMap(Knowledge):
    """Sparse 3D Gaussian map of the objects of interest. Not thread-safe: its owner locks.

    What an update costs follows what is in view, not the size of the map.
    """

    def reset(self) -> None:
        """Forget everything."""
        super().reset()
        self._past = PastViews(self._settings.past_views)

    # Updates ------------------------------------------------------------------------------------

    def set_context(self, context: SearchContext) -> None:
        """Ask for the classes of a context from now on; what is known of others stays."""
        if context == self._context:
            return
        store = self._store
        classes = {r.class_name for r in self._registry.records.values()}
        voxels = {name: self._voxel_m(name) for name in classes}
        self._context = context
        for c in context.distinct():
            store.column(c.name)
            self._roles.pop(c.name, None)  # those at the end were asked for last
            self._roles[c.name] = c.role
        self._forget_classes(
            list(self._roles)[: -max(self._settings.max_classes, len(self._names))]
        )
        for name in sorted(classes & self._roles.keys()):
            if self._voxel_m(name) != voxels[name]:
                self._registry.recluster(store, name, self._voxel_m(name))
        self._believe(np.arange(len(store)))
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
        gone = np.empty(0, np.int32)
        if s.creation_rule != "paper":
            projection, gone = self._carve(projection, reading, look)
        rendering = projection.render()

        created_mask = self._creation_mask(reading, rendering)
        created = self._create(reading, created_mask)
        if created:  # what was out of view still is
            new = np.arange(len(store) - created, len(store), dtype=np.int32)
            self._look_back(new)
            projection = projection.renewed(gone[:0], self._project(reading.view, rows=new))
        seen = reobserved(
            reading.depth_m, rendering, created_mask, s.reobserve_agreement_m, s.closing_px
        )
        labels = np.where(seen, reading.labels, -1).astype(np.int32)
        eye_m = reading.view.T_world_cam[:3, 3]
        weights = self._weights_of_all_before(look)
        fused = self._fuse(projection, labels, look, eye_m, observation.frame.stamp_ns)
        if weights is not None:
            self._past.note(reading, self._names, weights)
        self._updates += 1
        store.remove(gone)
        self._remove(surplus(store.believed, store.seen, s.max_gaussians))
        return UpdateReport(created, len(gone), len(projection.rows), fused, len(store))

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
        self._remove(gone)
        self._past.forget(lambda name: not self._is_receptacle(name))
        return len(gone)

    # Parts ----------------------------------------------------------------------------------------

    def _forget_classes(self, names: list[str]) -> None:
        """All evidence for some classes goes, and the instances of them."""
        store = self._store
        if not names:
            return
        columns = [store.class_names.index(name) for name in names]
        rows = np.flatnonzero(np.isin(store.believed, columns))
        self._registry.leave(store, rows, self._voxel_m)
        store.believed[rows] = OTHER
        self._join(rows)
        store.drop_columns(names)
        for name in names:
            self._viewpoints.forget(name)
            self._registry.ended.pop(name, None)
            del self._roles[name]

    def _carve(
        self, projection: Projection, reading: Reading, look: Look
    ) -> tuple[Projection, NDArray[np.int32]]:
        """Fade what is seen through, restore what is there, and give up what enough views saw
        through: the projection as it is then, and the rows that are to be removed."""
        s, store = self._settings, self._store
        seen = sight(projection, reading.depth_m, s.carve_front_m)
        there = seen.there[store.through[projection.rows[seen.there]] > 0]
        restored = projection.rows[there]
        store.through[restored], store.through_from[restored] = 0, NEVER
        through = projection.rows[seen.through]
        share = self._viewpoints.between(look, store.through_from[through])
        counted = through[share > 0]
        store.through[counted] += share[share > 0]
        store.through_from[counted] = look.viewpoint
        changed = np.concatenate([restored, counted])
        if not len(changed):
            return projection, changed
        left = np.maximum(1 - store.through[changed] / s.carve_views, 0)
        store.opacity[changed] = s.opacity * left
        is_gone = store.through[changed] >= WHOLE * s.carve_views
        gone, stays = changed[is_gone], changed[~is_gone]
        self._registry.leave(store, gone, self._voxel_m)
        store.believed[gone] = OTHER
        return projection.renewed(
            np.concatenate([there, seen.through[share > 0]]),
            self._project(reading.view, rows=stays),
        ), gone

    def _creation_mask(self, reading: Reading, rendering: Rendering) -> NDArray[np.bool_]:
        detected = (reading.labels != OTHER_LABEL) | self._settings.full_scene
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

    def _weights_of_all_before(self, look: Look) -> NDArray[np.float32] | None:
        """What a look counts for things older than every view [names]; None without hindsight."""
        if self._settings.evidence != "hindsight":
            return None
        return self._viewpoints.weights(look, self._names, np.array([NEVER]))[0]

    def _look_back(self, rows: NDArray[np.int32]) -> None:
        """Tell new Gaussians what past views said of the places where they are."""
        s, store = self._settings, self._store
        for shown in self._past.of(store.means[rows]):
            past = shown.past
            counts = [i for i, name in enumerate(past.names) if name in store.class_names]
            columns = [store.class_names.index(past.names[i]) for i in counts]
            told = rows[shown.points]
            kappa = shown.labels[:, None] == [OTHER_LABEL, *(1 + i for i in counts)]
            kappa[:, 0] |= ~kappa.any(axis=1)
            weights = np.tile(past.weights[counts], (len(told), 1))
            eye_m = past.view.T_world_cam[:3, 3]
            sides.tell(
                store, told, kappa.astype(np.float32), columns, weights, eye_m, s.side_views,
                s.alpha_side,
            )  # fmt: skip

    def _fuse(
        self,
        projection: Projection,
        labels: NDArray[np.int32],
        look: Look,
        eye_m: NDArray[np.float64],
        stamp_ns: int,
    ) -> int:
        """Take the evidence of a view and renew the instances that it changed."""
        s, store, names = self._settings, self._store, self._names
        kappa = projection.kappa_sums(labels, 1 + len(names))
        rows = projection.rows
        store.seen[rows[kappa @ np.ones(kappa.shape[1], np.float32) > 0]] = self._updates
        weights = self._viewpoints.weights(look, names, store.born[rows])
        self._viewpoints.mark(look, names, self._updates)
        if s.by_sides:
            took = sides.tell(
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
            self._described.clear()  # what was learnt changes every score
        self._note_moments(given, stamp_ns)
        return len(rows)

    def _note_moments(self, labels: list[int], stamp_ns: int) -> None:
        """Add to the history of instances that took evidence; their description is out of date."""
        for label in labels:
            self._described.pop(label, None)
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

    def _believe(self, rows: NDArray[np.integer]) -> None:
        """Renew the beliefs of rows, and the instances that this changes."""
        store = self._store
        s = self._settings
        new = believe(
            store.positive, store.asked, rows, self._columns, s.prior_concentration,
            self._n_classes, s.named_from,
        )  # fmt: skip
        differs = np.flatnonzero(new != store.believed[rows])
        changed = rows[differs]
        self._registry.leave(store, changed, self._voxel_m)
        store.believed[changed] = new[differs]
        self._join(changed)

    def _join(self, rows: NDArray[np.integer], *, taken_out: bool = False) -> None:
        changed = self._registry.join(self._store, rows, self._voxel_m, taken_out=taken_out)
        for label in changed:
            self._described.pop(label, None)
