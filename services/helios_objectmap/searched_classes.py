"""Classes that a map knows, and those of the current search."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from helios_core.types import Detection, Role, SearchContext

from helios_objectmap.gaussians import GaussianStore
from helios_objectmap.instances.furniture import is_flat, is_furniture
from helios_objectmap.settings import ObjectMapSettings


class SearchedClasses:
    """Classes of the current search, and the roles of all classes with evidence.

    roles: class -> its newest role; the most recently searched classes stand at the end.
    """

    def __init__(self, settings: ObjectMapSettings, roles: dict[str, Role] | None = None) -> None:
        self._settings = settings
        self.context: SearchContext | None = None
        self.roles: dict[str, Role] = {} if roles is None else roles

    @property
    def names(self) -> list[str]:
        """Classes of the current search; empty before the first."""
        return [c.name for c in self.context.distinct()] if self.context is not None else []

    def among(self, scores: Mapping[str, float]) -> dict[str, float]:
        """The scores of classes of the current search."""
        return {name: scores[name] for name in self.names if name in scores}

    def sure_receptacles(self, detections: Iterable[Detection]) -> list[Detection]:
        """The detections of receptacles of the current search with a score from the threshold of
        their class on."""
        wanted = self.context.distinct() if self.context is not None else ()
        least = {c.name: c.threshold for c in wanted if c.role.is_receptacle}
        return [d for d in detections if d.class_name in least and d.score >= least[d.class_name]]

    @property
    def prior_classes(self) -> int:
        """Number of classes of the prior, "other" included."""
        return max(len(self.names) + 1, self._settings.prior_classes)

    def columns(self, store: GaussianStore) -> list[int]:
        """Store columns of the classes of the current search."""
        return [store.class_names.index(name) for name in self.names]

    def search(self, context: SearchContext) -> None:
        """Make a context the current search."""
        self.context = context
        for c in context.distinct():
            self.roles.pop(c.name, None)
            self.roles[c.name] = c.role

    def add_roles(self, roles: Mapping[str, Role]) -> None:
        """Add classes of another map, as if they had been searched before all others."""
        new = {name: role for name, role in roles.items() if name not in self.roles}
        known = dict(self.roles)
        self.roles.clear()
        self.roles |= new | known

    def oldest(self) -> list[str]:
        """Classes beyond the largest number that the map keeps, searched longest ago."""
        return list(self.roles)[: -max(self._settings.max_classes, len(self.names))]

    def is_receptacle(self, class_name: str) -> bool:
        return self.roles[class_name].is_receptacle

    def is_large(self, class_name: str) -> bool:
        return self.is_receptacle(class_name) or is_furniture(class_name)

    def voxel_m(self, class_name: str) -> float:
        """Edge (m) of the voxels that join Gaussians of a class into instances."""
        s = self._settings
        return s.receptacle_voxel_m if self.is_large(class_name) else s.object_voxel_m

    def labels_off_floor(self) -> list[int]:
        """Labels of the current search that no pixel on the floor has: large and not flat."""
        above_m = self._settings.furniture_above_m
        return [
            1 + i
            for i, name in enumerate(self.names)
            if self.is_large(name) and not is_flat(name, above_m)
        ]
